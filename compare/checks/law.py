"""What a law is, and what it may ask of an estimator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.cpu_time import cpu_seconds
from slamgauge.compare.estimators.loading import spent_by
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.recording import Recording


class NotJudgedError(Exception):
    """The estimate lacks what the law looks at; the text says what."""


@dataclass(frozen=True)
class Subject:
    """The estimator under examination.

    Attributes:
        name: what error texts call it.
        estimator: any callable `Recording -> Estimate`.
    """

    name: str
    estimator: Estimator

    def __call__(self, recording: Recording) -> Answer:
        """Its answer to a recording.

        Raises:
            UserError: it raised, or what it returned does not fit the recording.
        """
        return Answer(run_estimator(self.name, self.estimator, recording)[0])

    def cpu_seconds(self, recording: Recording) -> float:
        """Processor time of one run and of programs that it calls [s]; what else runs does not disturb it."""
        start = cpu_seconds()
        run_estimator(self.name, self.estimator, recording)
        spent = spent_by(self.estimator)
        return cpu_seconds() - start if spent is None else spent.cpu_seconds


@dataclass(frozen=True)
class Answer:
    """An estimate, asked for what it need not hold."""

    estimate: Estimate

    @property
    def poses(self) -> Float:
        """(N+1, 3)."""
        return self.estimate.poses

    @property
    def pose_covs(self) -> Float:
        """(N+1, 3, 3).

        Raises:
            NotJudgedError: there are none.
        """
        if self.estimate.pose_covs is None:
            raise NotJudgedError("no pose_covs given")
        return self.estimate.pose_covs

    @property
    def has_map(self) -> bool:
        """Whether it tells of landmarks."""
        return len(self.estimate.landmark_ids) > 0

    def landmark(self, name: int) -> Float:
        """(2,) where the landmark of that id is.

        Raises:
            NotJudgedError: the estimate tells of no landmarks at all.
        """
        return self.estimate.landmarks[self._row(name)]

    def landmark_cov(self, name: int) -> Float:
        """(2, 2) its covariance.

        Raises:
            NotJudgedError: there are none.
        """
        if self.estimate.landmark_covs is None:
            raise NotJudgedError("no landmark_covs given")
        return self.estimate.landmark_covs[self._row(name)]

    def _row(self, name: int) -> int:
        if not self.has_map:
            raise NotJudgedError("no landmarks given")
        rows = np.flatnonzero(self.estimate.landmark_ids == name)
        if not len(rows):
            raise UserError(f"landmark {name} was seen and is not in landmark_ids; add it at its first sight")
        return int(rows[0])


@dataclass(frozen=True, kw_only=True)
class Law:
    """A law that a filter must obey.

    Attributes:
        name: what tables and JSON call it.
        figure: what is measured, and its unit; 0 is perfect unless it says otherwise.
        bound: what the figure may be at most.
        reason: where the bound comes from.
        blame: the part of a filter that is to blame where the law is broken.
        judge: the figure of an estimator, its recordings drawn from the generator.
        excused_to: above the bound and up to here the figure is a limit of the textbook method, not a bug.
        limit: that limit in a sentence.
    """

    name: str
    figure: str
    bound: float
    reason: str
    blame: str
    judge: Callable[[Subject, np.random.Generator], float]
    excused_to: float = -np.inf
    limit: str = ""
