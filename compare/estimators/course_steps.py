"""The Octave course's two functions in Python: `prediction_step` and `correction_step`.

    prediction_step(mu, sigma, u) -> mu, sigma                         u = (r1, t, r2)
    correction_step(mu, sigma, z, observed) -> mu, sigma, observed     z = [(id, range, bearing), ...]

mu (3+2n,) has room for all n landmarks from the start, number j (0, 1, ... as in `observed`) at mu[3+2j : 5+2j]; sigma
begins with 1000 m^2 for each of their coordinates. A step turns by r1, goes t [m] ahead, turns by r2. Fields of u and z
can be had by position, as `u.r1` and as `u["r1"]`. Noise is what the functions have inside.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.estimators.fresh_modules import Code, Fresh
from slamgauge.compare.estimators.signatures import called, pair, required_of_pair
from slamgauge.compare.estimators.state_log import Trail
from slamgauge.compare.estimators.user_code import OwnCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import wrap
from slamgauge.sensors import SENSORS

PREDICTION, CORRECTION = "prediction_step", "correction_step"
UNSEEN = 1000.0  # variance [m^2] of a landmark that has not been seen


class Turn(NamedTuple):
    """An increment as u = (r1, t, r2) [rad, m, rad]."""

    r1: float
    t: float
    r2: float

    def __getitem__(self, key: Any) -> Any:
        """A field by its position or its name."""
        return getattr(self, key) if isinstance(key, str) else tuple.__getitem__(self, key)


class Sight(NamedTuple):
    """An observation: number of the landmark, range [m], bearing [rad]."""

    id: int
    range: float
    bearing: float

    def __getitem__(self, key: Any) -> Any:
        """A field by its position or its name."""
        return getattr(self, key) if isinstance(key, str) else tuple.__getitem__(self, key)


def description(given: Fresh) -> str | None:
    """What people are told of one of both functions, beside the other; None for anything else."""
    found = required_of_pair(given, (PREDICTION, CORRECTION), (3, 4))
    if found is None:
        return None
    return f"functions of the Octave course, {PREDICTION} ({', '.join(found[0])}) and {CORRECTION}"


@dataclass(frozen=True)
class CourseSteps:
    """Both functions as an estimator.

    Attributes:
        code: where one of them comes from; the other one stands beside it.
    """

    code: Code

    def __call__(self, recording: Recording) -> Estimate:
        """Run them over a recording.

        Raises:
            OwnCodeError: a recording that they cannot be fed with, or what they return is no state.
        """
        if recording.landmark is None or not SENSORS[recording.sensor].has_range:
            raise OwnCodeError("the course's functions need ranges, bearings and ids; give a recording that has them")
        trail = Trail(recording, ("mu", "sigma"))
        with self.code.fresh() as fresh:
            belief = _Belief(fresh.beside[PREDICTION], fresh.beside[CORRECTION], recording)
            for step, scan in enumerate(recording.scans()):
                trail.step(step, scan.landmark, lambda step=step, scan=scan: belief.advanced(step, scan))
        return trail.estimate()


class _Belief:
    """State, covariance and marks as the functions hand them on.

    Args:
        predict: `prediction_step`.
        correct: `correction_step`.
        recording: what they are fed.
    """

    def __init__(self, predict: Any, correct: Any, recording: Recording) -> None:
        self._predict, self._correct, self._recording = predict, correct, recording
        self._numbers = {name: j for j, name in enumerate(np.unique(np.asarray(recording.landmark)).tolist())}
        count = len(self._numbers)
        self._mu: Any = np.concatenate([recording.prior_mean, np.zeros(2 * count)])
        self._sigma: Any = np.diag(np.full(3 + 2 * count, UNSEEN))
        self._sigma[:3, :3] = recording.prior_cov
        self._observed: Any = np.zeros(count, dtype=bool)
        self._mapped: list[int] = []

    def advanced(self, step: int, scan: Observations) -> tuple[Float, Float]:
        """State and covariance after a step, landmarks that were seen alone, in the order of first sight."""
        if step > 0:
            u = turn(self._recording.odometry[step - 1])
            self._mu, self._sigma, *_ = pair(called(self._predict, self._mu, self._sigma, u), PREDICTION)
        if len(scan.value) and scan.landmark is not None:
            self._correct_with(step, scan.landmark, scan.value)
        mu, sigma = np.array(self._mu, np.float64).reshape(-1), np.array(self._sigma, np.float64)
        rows = np.r_[0:3, [3 + 2 * j + axis for j in self._mapped for axis in (0, 1)]].astype(np.int64)
        return mu[rows], sigma[np.ix_(rows, rows)]

    def _correct_with(self, step: int, ids: Int, values: Float) -> None:
        numbers = [self._numbers[name] for name in ids.tolist()]
        z = [Sight(j, *value) for j, value in zip(numbers, values.tolist(), strict=True)]
        self._mu, self._sigma, *marks = pair(
            called(self._correct, self._mu, self._sigma, z, self._observed), CORRECTION
        )
        self._observed = marks[0] if marks else self._observed
        new = [j for j in dict.fromkeys(numbers) if j not in self._mapped]
        unmapped = [j for j in new if not np.any(np.array(self._mu).reshape(-1)[3 + 2 * j : 5 + 2 * j])]
        if unmapped:
            where = f"mu[{3 + 2 * unmapped[0]}:{5 + 2 * unmapped[0]}]"
            remedy = "number landmarks from 0, as Python does"
            raise OwnCodeError(f"step {step}: landmark {unmapped[0]} was seen, but {where} is still zero; {remedy}")
        self._mapped += new


def turn(increment: Float) -> Turn:
    """The body-frame increment (3,) [m, m, rad] as two turns and a way; backwards t is negative."""
    dx, dy, dtheta = increment.tolist()
    sign = -1.0 if dx < 0 else 1.0
    r1 = float(np.arctan2(sign * dy, sign * dx))
    return Turn(r1, sign * float(np.hypot(dx, dy)), float(wrap(dtheta - r1)))
