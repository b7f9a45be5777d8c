"""A check, the estimator under test, and access to its estimates."""

from __future__ import annotations

from collections.abc import Callable, Set
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.recording import Recording

Need = Literal["odometry noise", "observation noise", "prior", "ids"]


class NotJudgedError(Exception):
    """The estimate lacks a field that the check needs. The message names the field."""


class OtherModelError(Exception):
    """The estimate is that of a right filter with another motion model. The message describes it."""


@dataclass
class Subject:
    """The estimator under test."""

    name: str  # in error messages
    estimator: Estimator  # any callable `Recording -> Estimate`
    ignored: Set[Need] = frozenset()  # inputs that do not change its estimates (see `ignored_inputs`)
    is_confused: bool = False  # its own association confused landmarks in a run, or it did not show its landmarks
    is_overdue: bool = False  # it exceeded the time limit in an earlier check
    cause: str = ""  # name of the check of the part that explains a failure of `truth-recovered`, if it is known

    def ignores(self, *needs: Need) -> bool:
        """Return whether it ignores any of these inputs."""
        return not self.ignored.isdisjoint(needs)

    @property
    def has_own_noise(self) -> bool:
        """Whether it ignores noise of the recording."""
        return self.ignores("odometry noise", "observation noise")

    def __call__(self, recording: Recording) -> Estimate:
        """Return the estimate of a recording.

        If it ignores ids, it runs without them; its landmarks then have the ids in the order of first observations.

        Raises:
            UserError: the estimator raised an error, or its result does not fit the recording.
        """
        if not self.ignores("ids") or recording.landmark is None:
            return run_estimator(self.name, self.estimator, recording, remarked=False)[0]
        without_ids = replace(recording, landmark=None)
        estimate = run_estimator(self.name, self.estimator, without_ids, remarked=False)[0]
        names = np.array([*dict.fromkeys(recording.landmark.tolist())], dtype=np.int64)
        if len(estimate.landmark_ids) == len(names):
            return replace(estimate, landmark_ids=names)
        self.is_confused = True
        return Estimate(estimate.kind, estimate.poses, estimate.pose_covs)


def pose_covs_of(estimate: Estimate) -> Float:
    """Return the pose covariances (N+1, 3, 3), world frame; raise NotJudgedError if the estimate has none."""
    if estimate.pose_covs is None:
        raise NotJudgedError("the estimate has no pose_covs")
    return estimate.pose_covs


def landmark_of(estimate: Estimate, name: int) -> Float:
    """Return the position (2,) [m], world frame, of the landmark with the id `name` (see `_row`)."""
    return estimate.landmarks[_row(estimate, name)]


def landmark_cov_of(estimate: Estimate, name: int) -> Float:
    """Return the covariance (2, 2) [m^2] of a landmark (see `_row`); raise NotJudgedError if the estimate has none."""
    if estimate.landmark_covs is None:
        raise NotJudgedError("the estimate has no landmark_covs")
    return estimate.landmark_covs[_row(estimate, name)]


def _row(estimate: Estimate, name: int) -> int:
    """Return the row of a landmark; raise NotJudgedError without landmarks, UserError if only this one is missing."""
    if not len(estimate.landmark_ids):
        raise NotJudgedError("the estimate has no landmarks")
    rows = np.flatnonzero(estimate.landmark_ids == name)
    if not len(rows):
        raise UserError(f"landmark {name} was observed, but is not in landmark_ids; add it at its first observation")
    return int(rows[0])


Measure = Callable[[Subject, np.random.Generator], float]


@dataclass(frozen=True)
class Check:
    """A property that every correct filter has, measured by one number, the figure.

    A figure with `bound` < figure <= `excused_to` is a limit of the textbook method, not a failure. If a check that it
    presupposes fails, or one that these presuppose, its failure may follow from that one and is not judged.
    """

    measure: Measure  # computes the figure of an estimator; draws random recordings from the generator
    figure: str  # the measured quantity and its unit; 0 is perfect unless the text states another value
    bound: float  # largest figure that passes
    blame: str  # printed after a failure: the part of the filter that usually causes it
    excused_to: float = -np.inf  # excuses no figure
    limit: str = ""  # printed instead of `blame` for an excused figure
    needs: tuple[Need, ...] = ()  # a right filter that ignores one of these inputs may fail: it is not judged
    after: tuple[str, ...] = ()  # names of checks that it presupposes

    @property
    def name(self) -> str:
        """Name in tables and JSON: the name of the function `measure`, with hyphens."""
        return self.measure.__name__.replace("_", "-")


def check(**fields: Any) -> Callable[[Measure], Check]:
    """Return a decorator that turns the function `measure` into a `Check` with the other attributes of `Check`."""
    return lambda measure: Check(measure, **fields)
