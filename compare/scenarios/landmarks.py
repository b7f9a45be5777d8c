"""The map of a scenario: landmarks at given positions, or at random ones."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.section import NonNegative, Number, Section, Whole, invalid

_TRIES = 1000  # random positions tried for a landmark


class RandomLandmarks(Section, frozen=True):
    """`count` landmarks, uniform in the `box` (x from, y from, x to, y to) [m], at least `min_distance` [m] apart.

    `seed` is the seed of the map: all runs have the same map.
    """

    count: Annotated[Whole, Field(ge=1, le=100_000)]
    box: tuple[Number, Number, Number, Number]
    seed: Annotated[Whole, Field(ge=0)] = 0
    min_distance: NonNegative = 0.0

    @model_validator(mode="after")
    def _has_room(self) -> RandomLandmarks:
        if not (self.box[0] < self.box[2] and self.box[1] < self.box[3]):
            raise invalid("box is empty; give [x from, y from, x to, y to]")
        placed = len(self.positions)
        if placed < self.count:
            what = f"only {placed} of {self.count} landmarks fit at min_distance = {self.min_distance}"
            raise invalid(f"{what}; lower it or enlarge the box")
        return self

    @property
    def positions(self) -> Float:
        """Positions (count, 2) [m]; fewer if they do not fit."""
        return _scattered(self)


@lru_cache(maxsize=16)
def _scattered(chosen: RandomLandmarks) -> Float:
    generator = np.random.default_rng(chosen.seed)
    low, high = np.array(chosen.box[:2]), np.array(chosen.box[2:])
    if chosen.min_distance == 0.0:  # the same draws at once
        positions = generator.uniform(low, high, (chosen.count, 2))
        positions.setflags(write=False)
        return positions
    positions = np.empty((chosen.count, 2))
    for placed in range(chosen.count):
        for _ in range(_TRIES):
            place = generator.uniform(low, high)
            apart = np.hypot(*(positions[:placed] - place).T)
            if not (apart < chosen.min_distance).any():
                break
        else:
            positions = positions[:placed]
            break
        positions[placed] = place
    positions.setflags(write=False)
    return positions


class Landmarks(Section):
    """The map: `positions` of the landmarks, (x, y) [m], or `random` ones."""

    positions: tuple[tuple[Number, Number], ...] = ()
    random: RandomLandmarks | None = None

    @model_validator(mode="after")
    def _one_form(self) -> Landmarks:
        if self.random is not None and self.positions:
            raise invalid("has both forms; give positions, or random")
        if self.random is None and "positions" not in self.model_fields_set:
            raise invalid("has no landmarks; give positions ([] for none), or random")
        return self

    def all(self) -> Float:
        """Return the positions (L, 2) of all landmarks [m]."""
        if self.random is not None:
            return self.random.positions
        return np.array(self.positions, dtype=np.float64).reshape(-1, 2)
