"""The Octave course's functions in Python: one for odometry and one for observations.

    prediction_step(mu, sigma, u) -> mu, sigma                         u = (r1, t, r2)
    correction_step(mu, sigma, z, observed) -> mu, sigma, observed     z = [(id, range, bearing), ...]

mu (3+2n,) has room for all n landmarks from the start, number j (0, 1, ... as in `observed`) at mu[3+2j : 5+2j]; the
variances of their coordinates begin at 1000 m^2. A step turns by r1, moves t [m] ahead and turns by r2. Fields of u and
z can be read by position, as `u.r1` and as `u["r1"]`. The functions contain their own noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.estimators.forms.signatures import called, pair, required_of_pair
from slamgauge.compare.estimators.forms.state_log import StateLog
from slamgauge.compare.estimators.fresh_modules import Code, Fresh
from slamgauge.compare.estimators.user_code import UserCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import wrap
from slamgauge.sensors import SENSORS

PREDICTION, CORRECTION = COURSE = ("prediction_step", "correction_step")
UNSEEN = 1000.0  # variance [m^2] of a landmark that has not been observed


class Turn(NamedTuple):
    """An increment as u = (r1, t, r2) [rad, m, rad]."""

    r1: float
    t: float
    r2: float

    def __getitem__(self, key: Any) -> Any:
        """Return a field by its position or its name."""
        return getattr(self, key) if isinstance(key, str) else tuple.__getitem__(self, key)


class CourseObservation(NamedTuple):
    """An observation: number of the landmark, range [m], bearing [rad]."""

    id: int
    range: float
    bearing: float

    def __getitem__(self, key: Any) -> Any:
        """Return a field by its position or its name."""
        return getattr(self, key) if isinstance(key, str) else tuple.__getitem__(self, key)


def description(given: Fresh) -> str | None:
    """Describe one of the course's functions if its module has both; return None otherwise."""
    found = required_of_pair(given, COURSE, (3, 4))
    if found is None:
        return None
    return f"functions of the Octave course, {PREDICTION} ({', '.join(found[0])}) and {CORRECTION}"


@dataclass(frozen=True)
class CourseSteps:
    """The course's functions as an estimator; `code` is the source of one of them."""

    code: Code

    def __call__(self, recording: Recording) -> Estimate:
        """Run the functions over a recording.

        Raises:
            UserCodeError: the recording lacks ranges, bearings or ids, or a function returns no state.
        """
        if recording.landmark is None or not SENSORS[recording.sensor].has_range:
            raise UserCodeError("the course's functions need ranges, bearings and ids; give a recording that has them")
        log = StateLog(recording, ("mu", "sigma"))
        with self.code.fresh() as fresh:
            belief = _CourseBelief(fresh.names[PREDICTION], fresh.names[CORRECTION], recording)
            for step, scan in enumerate(recording.scans()):
                log.step(step, scan.landmark, lambda step=step, scan=scan: belief.advanced(step, scan))
        return log.estimate()


class _CourseBelief:
    """State, covariance and `observed`, as the course's functions pass them on."""

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
        """Return state and covariance after a step, with observed landmarks only, in the order of first observation."""
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
        z = [CourseObservation(j, *value) for j, value in zip(numbers, values.tolist(), strict=True)]
        self._mu, self._sigma, *marks = pair(
            called(self._correct, self._mu, self._sigma, z, self._observed), CORRECTION
        )
        self._observed = marks[0] if marks else self._observed
        new = [j for j in dict.fromkeys(numbers) if j not in self._mapped]
        unmapped = [j for j in new if not np.any(np.array(self._mu).reshape(-1)[3 + 2 * j : 5 + 2 * j])]
        if unmapped:
            where = f"mu[{3 + 2 * unmapped[0]}:{5 + 2 * unmapped[0]}]"
            remedy = "number landmarks from 0, as Python does"
            raise UserCodeError(f"step {step}: landmark {unmapped[0]} was seen, but {where} is still zero; {remedy}")
        self._mapped += new


def turn(increment: Float) -> Turn:
    """Convert the body-frame increment (3,) [m, m, rad] to two turns and a distance; backwards t is negative."""
    dx, dy, dtheta = increment.tolist()
    sign = -1.0 if dx < 0 else 1.0
    r1 = float(np.arctan2(sign * dy, sign * dx))
    return Turn(r1, sign * float(np.hypot(dx, dy)), float(wrap(dtheta - r1)))
