"""`Recording`, everything an estimator receives of a run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np

from slamgauge.arrays import Float, Int, Marks, chunks, distinct
from slamgauge.display import counted
from slamgauge.errors import UserError
from slamgauge.se2 import compose
from slamgauge.sensors import SENSORS, Sensor, inverse
from slamgauge.validation import Record, as_covariances, as_floats, as_ints, for_all, require_rows, store


class Observations(NamedTuple):
    """The observations of one step: ids (m,) or None, values (m, d) and covariances (m, d, d) as in a `Recording`."""

    landmark: Int | None
    value: Float
    cov: Float


@dataclass(frozen=True, slots=True, eq=False)
class Recording(Record):
    """Everything an estimator receives: N odometry increments and M landmark observations.

    Attributes:
        stamps: (N+1,) [s], strictly increasing; step k leads from stamp k-1 to stamp k.
        prior_mean: (3,) mean of the start pose.
        prior_cov: (3, 3) its covariance; zero for a fixed start.
        odometry: (N, 3) body-frame increments (dx, dy, dtheta).
        odometry_cov: (N, 3, 3) assumed by estimators; may be singular. A single (3, 3) is valid for all steps.
        sensor: `range-bearing` (range [m], bearing [rad]), `bearing` ([rad]) or `position`
            (landmark in the body frame, [m]).
        observation_step: (M,) in 0..N, in increasing order.
        observation: (M, d) values.
        observation_cov: (M, d, d) assumed by estimators, positive definite. A single (d, d) is valid for all.
        landmark: (M,) ids >= 0, or None if the association is unknown.
    """

    stamps: Float
    prior_mean: Float
    prior_cov: Float
    odometry: Float
    odometry_cov: Float
    sensor: Sensor
    observation_step: Int
    observation: Float
    observation_cov: Float
    landmark: Int | None

    def __post_init__(self) -> None:
        odometry = as_floats("odometry", self.odometry, (None, 3))
        steps = len(odometry)
        stamps = as_floats("stamps", self.stamps, (steps + 1,))
        require_rows(
            "stamps", np.diff(stamps, prepend=-np.inf) > 0, stamps, "stamps must increase strictly; sort the steps"
        )
        if self.sensor not in SENSORS:
            raise UserError(f"sensor: {self.sensor!r} is not known; use one of {', '.join(SENSORS)}")
        dim = SENSORS[self.sensor].dim
        observation = as_floats("observation", self.observation, (None, dim))
        count = len(observation)
        if SENSORS[self.sensor].has_range:
            require_rows("observation", observation[:, 0] >= 0, observation, "a range cannot be negative; drop the row")
        observation_step = as_ints("observation_step", self.observation_step, (count,))
        in_range = (observation_step >= 0) & (observation_step <= steps)
        require_rows("observation_step", in_range, observation_step, f"a step must lie in 0..{steps}")
        ordered = np.append(True, observation_step[1:] >= observation_step[:-1])[:count]
        require_rows(
            "observation_step", ordered, observation_step, "steps must not decrease; sort the observations by step"
        )
        landmark = None
        if self.landmark is not None:
            landmark = as_ints("landmark", self.landmark, (count,))
            require_rows(
                "landmark", landmark >= 0, landmark, "an id must be >= 0; use landmark=None for unknown association"
            )
        store(
            self,
            stamps=stamps,
            prior_mean=as_floats("prior_mean", self.prior_mean, (3,)),
            prior_cov=as_covariances("prior_cov", self.prior_cov, (3, 3)),
            odometry=odometry,
            odometry_cov=as_covariances("odometry_cov", for_all(self.odometry_cov, steps), (steps, 3, 3)),
            observation=observation,
            observation_step=observation_step,
            observation_cov=as_covariances(
                "observation_cov", for_all(self.observation_cov, count), (count, dim, dim), definite=True
            ),
            landmark=landmark,
        )

    def __repr__(self) -> str:
        whose = "without ids" if self.landmark is None else f"of {counted(len(distinct(self.landmark)), 'landmark')}"
        steps, seen = counted(self.steps, "step"), counted(len(self.observation), "observation")
        return f"Recording({self.sensor}, {steps}, {self.stamps[-1] - self.stamps[0]:.6g} s, {seen} {whose})"

    @property
    def steps(self) -> int:
        """Number N of odometry increments."""
        return len(self.odometry)

    def first(self, steps: int) -> Self:
        """Return the recording up to pose `steps`, with the observations of that pose."""
        last = int(np.searchsorted(self.observation_step, steps, side="right"))
        steps_only = {name: getattr(self, name)[:steps] for name in ("odometry", "odometry_cov")}
        return replace(self.only(slice(last)), stamps=self.stamps[: steps + 1], **steps_only)

    def only(self, kept: Marks | Int | slice) -> Self:
        """Return the recording with the observations marked in `kept` (M,), or in these rows, only."""
        return replace(
            self,
            observation_step=self.observation_step[kept],
            observation=self.observation[kept],
            observation_cov=self.observation_cov[kept],
            landmark=None if self.landmark is None else self.landmark[kept],
        )

    def associated(self, association: Int) -> Self:
        """Return the recording with the ids of an `Estimate.association` (M,), without rejected observations (-1)."""
        kept = np.asarray(association) >= 0
        return replace(self, landmark=np.where(kept, association, 0)).only(kept)

    def positions_seen(self, rows: Int, path: Float) -> Float:
        """Return positions (n, 2) [m], world frame, of the landmarks of the observations `rows` from a path (N+1, 3).

        A bearing without a range puts its landmark at a distance of 1 m.
        """
        seen = inverse(self.sensor, self.observation[rows])
        poses = path[self.observation_step[rows]]
        return compose(poses, np.column_stack([seen, np.zeros(len(seen))]))[:, :2]

    def scans(self) -> Iterator[Observations]:
        """Yield the observations of step 0, 1, ..., N (views, not copies)."""
        for steps in chunks(self.steps + 1):
            bounds = np.searchsorted(self.observation_step, np.arange(steps.start, steps.stop + 1)).tolist()
            for first, last in pairwise(bounds):
                ids = None if self.landmark is None else self.landmark[first:last]
                yield Observations(ids, self.observation[first:last], self.observation_cov[first:last])
