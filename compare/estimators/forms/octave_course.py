"""The Octave course's functions in Python: one for odometry and one for observations.

    prediction_step(mu, sigma, u) -> mu, sigma                         u = (r1, t, r2)
    correction_step(mu, sigma, z, observed) -> mu, sigma, observed     z = [(id, range, bearing), ...]

mu has room for all n landmarks from the start, number j (0, 1, ... in the order of ids) at mu[3+2j : 5+2j]; the
variances of their coordinates begin at 1000 m^2. A step turns by r1, moves t [m] ahead and turns by r2. The functions
contain their own noise. Shapes and kinds of the arguments are found by a tiny recording (`octave_conventions`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.columns import use_columns
from slamgauge.compare.estimators.forms.octave_conventions import TRIED, Convention, conventions
from slamgauge.compare.estimators.forms.octave_functions import CourseFunction, CoursePair, course_pair
from slamgauge.compare.estimators.forms.probing import TinyRecording, closest, tiny_recording
from slamgauge.compare.estimators.forms.signatures import pair
from slamgauge.compare.estimators.forms.state_log import StateLog
from slamgauge.compare.estimators.fresh_modules import Code, Fresh
from slamgauge.compare.estimators.user_code import UserCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import wrap
from slamgauge.sensors import SENSORS

UNSEEN = 1000.0  # variance [m^2] of a landmark that has not been observed
UNSET = 1000.0  # error [m] in the tiny recording of an observed landmark that is still zero


def description(given: Fresh) -> str | None:
    """Describe one of the course's functions if its module, or a neighbour, has the other; return None otherwise."""
    found = course_pair(given.names)
    if found is None or given.callee not in (found.predict.function, found.correct.function):
        return None
    return (
        f"functions of the Octave course, {found.predict.name} ({', '.join(found.predict.parameters)}) "
        f"and {found.correct.name}"
    )


@dataclass(frozen=True)
class CourseSteps:
    """The course's functions as an estimator.

    Attributes:
        code: source of one of them.
        found: the convention that they follow, once it is known.
    """

    code: Code
    found: list[Convention] = field(default_factory=list[Convention], compare=False)

    def __call__(self, recording: Recording) -> Estimate:
        """Run the functions over a recording.

        Raises:
            UserCodeError: the recording lacks ranges, bearings or ids, the functions fit no convention, or a function
                returns no state.
        """
        if recording.landmark is None or not SENSORS[recording.sensor].has_range:
            raise UserCodeError("the course's functions need ranges, bearings and ids; give a recording that has them")
        if not self.found:
            with self.code.fresh() as fresh:
                self.found.append(_convention_of(_functions(fresh)))
        log = StateLog(recording, ("mu", "sigma"))
        with self.code.fresh() as fresh:
            belief = _CourseBelief(_functions(fresh), self.found[0], recording)
            for step, scan in enumerate(recording.scans()):
                log.step(step, scan.landmark, partial(belief.advanced, step, scan))
        return log.estimate()

    def remarks(self, recording: Recording) -> list[str]:  # noqa: ARG002 the same for all recordings
        """Return the convention that was found."""
        return [f"the course's functions take {each.words()}; their own noise counts" for each in self.found]


def _functions(fresh: Fresh) -> CoursePair:
    found = course_pair(fresh.names)
    if found is None:
        raise UserCodeError(
            "its module no longer has both functions of the course; define prediction_step and correction_step"
        )
    return found


def _convention_of(functions: CoursePair) -> Convention:
    """Return the convention by which the functions keep to the answer of the tiny recording best."""
    tiny = tiny_recording(sideways=0.1)
    return closest(conventions(), lambda convention: _errors(functions, tiny, convention), TRIED)


def _errors(functions: CoursePair, tiny: TinyRecording, convention: Convention) -> Iterator[float]:
    """Yield the largest error [m, rad] after each call."""
    belief = _CourseBelief(functions, convention, tiny.recording)
    for step, scan in enumerate(tiny.recording.scans()):
        if step > 0:
            belief.predict(step)
            yield belief.error(tiny.poses[step], tiny.landmarks)
            belief.correct(scan)
            yield belief.error(tiny.poses[step], tiny.landmarks)


class _CourseBelief:
    """State, covariance and `observed`, as the course's functions pass them on."""

    def __init__(self, functions: CoursePair, convention: Convention, recording: Recording) -> None:
        self._functions, self._convention, self._recording = functions, convention, recording
        self._numbers = {name: j for j, name in enumerate(np.unique(np.asarray(recording.landmark)).tolist())}
        self._count = len(self._numbers)
        self._mu: Any = convention.state(np.concatenate([recording.prior_mean, np.zeros(2 * self._count)]))
        self._sigma: Any = np.diag(np.full(3 + 2 * self._count, UNSEEN))
        self._sigma[:3, :3] = recording.prior_cov
        self._observed = convention.marks(self._count)
        self._mapped: list[int] = []
        self._step = 0
        if convention.mu == "numbers":
            for each in functions:
                use_columns(each.function.__globals__)

    def predict(self, step: int) -> None:
        """Call the function for odometry."""
        self._step = step
        self._call(self._functions.predict, self._convention.increment(self._recording.odometry[step - 1]))

    def correct(self, scan: Observations) -> None:
        """Call the function for observations."""
        numbers = [self._numbers[name] for name in np.asarray(scan.landmark).tolist()]
        z = self._convention.scan(numbers, scan.value)
        marks = self._call(self._functions.correct, z, self._observed)
        self._observed = marks[0] if marks else self._observed
        self._mapped += [j for j in dict.fromkeys(numbers) if j not in self._mapped]

    def advanced(self, step: int, scan: Observations) -> tuple[Float, Float]:
        """Return state and covariance after a step, with observed landmarks only, in the order of first observation."""
        if step > 0:
            self.predict(step)
        if len(scan.value):
            self.correct(scan)
            for j in self._unset():
                where = f"mu[{3 + 2 * j}:{5 + 2 * j}]"
                remedy = "set it at the first observation; landmark j, counted from 0, begins at mu[3 + 2 * j]"
                raise UserCodeError(f"step {step}: landmark {j} was seen, but {where} is still zero; {remedy}")
        mu, sigma = self._state()
        rows = np.r_[0:3, [3 + 2 * j + axis for j in self._mapped for axis in (0, 1)]].astype(np.int64)
        return mu[rows], sigma[np.ix_(rows, rows)]

    def error(self, pose: Float, landmarks: Float) -> float:
        """Return the largest difference from a pose and the positions of mapped landmarks."""
        mu, _ = self._state()
        map_error = mu[3:].reshape(-1, 2)[self._mapped] - landmarks[self._mapped]
        errors = [*np.abs(mu[:2] - pose[:2]), abs(wrap(mu[2] - pose[2])), *np.abs(map_error).reshape(-1)]
        return float(np.max(errors)) + UNSET * len(self._unset())

    def _call(self, function: CourseFunction, *arguments: object) -> list[object]:
        """Call a function, keep state and covariance, and return its further values.

        A function that returns nothing has changed its arguments.
        """
        values = (self._mu, self._sigma, *arguments)
        returned = function(values, self._count, is_first=self._step <= 1)
        if returned is None:
            return []
        self._mu, self._sigma, *rest = pair(returned, function.name)
        return rest

    def _state(self) -> tuple[Float, Float]:
        """Return the state (2N+3,) and its covariance."""
        size = 3 + 2 * self._count
        shapes = np.shape(self._mu), np.shape(self._sigma)
        if np.size(self._mu) != size or shapes[1] != (size, size):
            what = f"step {self._step}: mu has shape {shapes[0]} and sigma {shapes[1]}"
            raise UserCodeError(f"{what}; return ({size},) or ({size}, 1) and ({size}, {size})")
        with suppress(TypeError, ValueError):
            return np.array(self._mu, np.float64).reshape(-1), np.array(self._sigma, np.float64)
        raise UserCodeError(f"step {self._step}: mu or sigma is no array of numbers; return arrays of floats")

    def _unset(self) -> list[int]:
        """Return the mapped landmarks whose coordinates are still zero."""
        places = self._state()[0][3:].reshape(-1, 2).tolist()
        return [j for j in self._mapped if not any(places[j])]
