"""The map of a scenario: landmarks at given places, or drawn at random."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.section import NonNegative, Section
from slamgauge.compare.scenarios.settings_sections import Number, Whole

_TRIES = 1000  # places that are tried for a landmark before it is said that there is no room


class RandomLandmarks(Section):
    """`count` landmarks, uniform in the `box` (x from, y from, x to, y to) [m], no two nearer than `min_distance` [m].

    The `seed` is the map's own: all runs have the same map.
    """

    count: Annotated[Whole, Field(ge=1, le=100_000)]
    box: tuple[Number, Number, Number, Number]
    seed: Annotated[Whole, Field(ge=0)] = 0
    min_distance: NonNegative = 0.0

    @model_validator(mode="after")
    def _has_room(self) -> RandomLandmarks:
        if not (self.box[0] < self.box[2] and self.box[1] < self.box[3]):
            raise PydanticCustomError("box", "box holds nothing; give [x from, y from, x to, y to]")
        placed = len(self.positions)
        if placed < self.count:
            text = "only {placed} of {count} landmarks fit at min_distance = {least}; lower it or enlarge the box"
            raise PydanticCustomError("room", text, {"placed": placed, "count": self.count, "least": self.min_distance})
        return self

    @property
    def positions(self) -> Float:
        """(count, 2) [m]; fewer if there is no room."""
        return _scattered(self.count, self.box, self.seed, self.min_distance)


@lru_cache(maxsize=16)
def _scattered(count: int, box: tuple[float, float, float, float], seed: int, min_distance: float) -> Float:
    generator = np.random.default_rng(seed)
    low, high = np.array(box[:2]), np.array(box[2:])
    positions = np.empty((count, 2))
    for placed in range(count):
        for _ in range(_TRIES):
            place = generator.uniform(low, high)
            apart = np.hypot(*(positions[:placed] - place).T)
            if not (apart < min_distance).any():
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
            raise PydanticCustomError("forms", "has both forms; give positions, or random")
        if self.random is None and "positions" not in self.model_fields_set:
            raise PydanticCustomError("forms", "has no landmarks; give positions ([] for none), or random")
        return self

    def all(self) -> Float:
        """Positions (L, 2) of all [m]."""
        if self.random is not None:
            return self.random.positions
        return np.array(self.positions, dtype=np.float64).reshape(-1, 2)
