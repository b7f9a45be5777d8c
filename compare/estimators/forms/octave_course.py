"""The Octave course's functions in Python: one for odometry and one for observations.

    prediction_step(mu, sigma, u) -> mu, sigma                         u = (r1, t, r2)
    correction_step(mu, sigma, z, observed) -> mu, sigma, observed     z = [(id, range, bearing), ...]

A step turns by r1, moves t [m] ahead and turns by r2. mu has room for all landmarks that have been observed so far,
number j (0, 1, ... in the order of first observation) at mu[3+2j : 5+2j]: a new one is at zero with variances of
1000 m^2. So nothing depends on later observations. The noise inside the functions is replaced by that of the recording
(`inner_noise`). Shapes and kinds of the arguments are found by a tiny recording (`octave_conventions`).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.columns import use_columns
from slamgauge.compare.estimators.forms.inner_noise import with_noise
from slamgauge.compare.estimators.forms.inputs import (
    block_diagonal,
    increment_cov,
    noise_remark,
    require_ranges_and_bearings,
    world_cov,
)
from slamgauge.compare.estimators.forms.octave_conventions import Convention, conventions
from slamgauge.compare.estimators.forms.octave_functions import CourseFunction, CoursePair, course_pair
from slamgauge.compare.estimators.forms.probing import best_of, tiny_recording
from slamgauge.compare.estimators.forms.signatures import pair
from slamgauge.compare.estimators.forms.state_log import StateLog, Steps
from slamgauge.compare.estimators.fresh_modules import Code, Fresh
from slamgauge.compare.estimators.user_code import Noise, UserCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording

ROBOT = 3
UNSEEN = 1000.0  # variance [m^2] of a landmark that has not been observed
GIVEN = "u is (r1, t, r2), z has id, range and bearing"
OWN = "its own noise counts: its functions do not have the form G @ sigma @ G.T + R and H @ sigma @ H.T + Q"


def description(given: Fresh) -> str | None:
    """Describe one of the course's functions if its module, or a neighbour, has the other; return None otherwise."""
    found = course_pair(given.names)
    if found is None or given.callee not in (found.predict.function, found.correct.function):
        return None
    return (
        f"functions of the Octave course, {found.predict.name} ({', '.join(found.predict.parameters)}) "
        f"and {found.correct.name}"
    )


@dataclass
class CourseSteps:
    """The course's functions as an estimator.

    Attributes:
        code: source of one of them.
        noise: assumed noise: that of the recording, or that inside the functions.
        replaces_noise: whether the noise of the recording replaced another one of the file in the last run.
    """

    code: Code
    noise: Noise = "recording"
    _convention: Convention | None = field(default=None, init=False)
    _remarks: list[str] = field(default_factory=list, init=False)
    replaces_noise: bool = field(default=False, init=False)

    def __call__(self, recording: Recording) -> Estimate:
        """Run the functions over a recording.

        Raises:
            UserCodeError: the recording lacks ranges, bearings or ids, the functions fit no convention, or a function
                returns no state.
        """
        require_ranges_and_bearings(recording)
        if recording.landmark is None:
            raise UserCodeError("the course's functions need ids; give a recording that has them")
        if self._convention is None:
            with self.code.fresh() as fresh:
                self._convention = _convention_of(_functions(fresh))
        with self.code.fresh() as fresh:
            filter_ = _CourseFilter(_functions(fresh), self._convention, recording)
            filter_.find_noise(is_replaced=self.noise == "recording")
            estimate = StateLog(recording).run(filter_)
        self.replaces_noise = filter_.replaces_noise
        found = [text for _, text in sorted(filter_.noise_remarks.items()) if text]
        self._remarks = [f"the course's functions take {self._convention.words()}", *filter_.count_remarks(), *found]
        return estimate

    def remarks(self, _recording: Recording) -> list[str]:
        """Return the convention that was found, and what was replaced or kept in the last run."""
        return self._remarks


def _convention_of(functions: CoursePair) -> Convention:
    """Return the convention by which the functions keep to the answer of the tiny recording best."""
    tiny = tiny_recording(1.0)
    return best_of(conventions(), lambda way: _CourseFilter(functions, way, tiny), tiny, given=GIVEN)


def _functions(fresh: Fresh) -> CoursePair:
    found = course_pair(fresh.names)
    if found is None:
        raise UserCodeError(
            "its module no longer has both functions of the course; define prediction_step and correction_step"
        )
    return found


class _CourseFilter(Steps):
    """State, covariance and `observed`, as the course's functions pass them on.

    Attributes:
        noise_remarks: sentences on the noise of motion and observations, as far as it is known.
        replaces_noise: whether the noise of the recording has replaced another one of the file.
    """

    names = ("mu", "sigma")

    def __init__(self, functions: CoursePair, convention: Convention, recording: Recording) -> None:
        self._functions, self._convention, self._recording = functions, convention, recording
        self._numbers: dict[int, int] = {}
        self._own_counts = functions.predict.count_globals() | functions.correct.count_globals()
        self._mu: Any = convention.state(recording.prior_mean.copy())
        self._sigma: Any = recording.prior_cov.copy()
        self._observed = convention.marks(0)
        self._step, self._heading, self._scan_covs = 0, recording.prior_mean[2], recording.observation_cov
        self._is_replaced = False
        self.noise_remarks: dict[str, str] = {}
        self.replaces_noise = False
        if convention.mu == "numbers":
            for each in functions:
                use_columns(each.function.__globals__)

    def find_noise(self, *, is_replaced: bool) -> None:
        """Find the noise inside the functions, and replace it by that of the recording if requested."""
        self._is_replaced = is_replaced
        hooks = (self._motion_noise, self._observation_noise)
        found = [with_noise(f.function, f.name_of_cov, hook) for f, hook in zip(self._functions, hooks, strict=True)]
        if None in found:
            self.noise_remarks["all"] = OWN
        else:
            self._functions = CoursePair(*(f._replace(function=g) for f, g in zip(self._functions, found, strict=True)))

    def advanced(self, step: int, scan: Observations) -> tuple[Float, Float]:
        """Return state and covariance after a step."""
        self._step = step
        if step > 0:
            self._heading = self._state()[0][2]  # the function may change mu before it adds its noise
            self._call(self._functions.predict, self._convention.increment(self._recording.odometry[step - 1]))
        if len(scan.value):
            self._make_room(np.asarray(scan.landmark).tolist())
            numbers = [self._numbers[name] for name in np.asarray(scan.landmark).tolist()]
            self._scan_covs = scan.cov
            z = self._convention.scan(numbers, scan.value)
            marks = self._call(self._functions.correct, z, self._observed)
            self._observed = marks[0] if marks else self._observed
            self._require_set()
        return self._state()

    def count_remarks(self) -> list[str]:
        """Return a sentence for each number of landmarks of the file that differs from the final one."""
        given = len(self._numbers)
        end = f"is replaced by the recording's, the landmarks observed so far ({given} at the end)"
        return [f"{name} of the file, {own}, {end}" for name, own in self._own_counts.items() if own != given]

    def _make_room(self, ids: list[int]) -> None:
        """Append landmarks that are observed for the first time."""
        new = [name for name in dict.fromkeys(ids) if name not in self._numbers]
        if not new:
            return
        mu, sigma = self._state()
        self._mu = self._convention.state(np.append(mu, np.zeros(2 * len(new))))
        self._sigma = block_diagonal(sigma, UNSEEN * np.eye(2 * len(new)))
        self._numbers |= {name: len(self._numbers) + j for j, name in enumerate(new)}
        self._observed = self._convention.marks(len(self._numbers), self._observed)

    def _call(self, function: CourseFunction, *arguments: object) -> list[object]:
        """Call a function, keep state and covariance, and return its further values.

        A function that returns nothing has changed its arguments.
        """
        values = (self._mu, self._sigma, *arguments)
        returned = function(values, len(self._numbers), is_first=self._step <= 1)
        if returned is None:
            return []
        self._mu, self._sigma, *rest = pair(returned, function.name)
        return rest

    def _state(self) -> tuple[Float, Float]:
        """Return the state (2N+3,) and its covariance."""
        size = 3 + 2 * len(self._numbers)
        shapes = np.shape(self._mu), np.shape(self._sigma)
        if np.size(self._mu) != size or shapes[1] != (size, size):
            what = f"step {self._step}: mu has shape {shapes[0]} and sigma {shapes[1]}"
            raise UserCodeError(f"{what}; return ({size},) or ({size}, 1) and ({size}, {size})")
        with suppress(TypeError, ValueError):
            return np.array(self._mu, np.float64).reshape(-1), np.array(self._sigma, np.float64)
        raise UserCodeError(f"step {self._step}: mu or sigma is not an array of numbers; return arrays of floats")

    def _require_set(self) -> None:
        """Refuse a map with a landmark whose coordinates are still zero."""
        is_set = self._state()[0][3:].reshape(-1, 2).any(axis=1)
        if not is_set.all():
            j = int(is_set.argmin())
            where = f"mu[{3 + 2 * j}:{5 + 2 * j}]"
            remedy = "set it at the first observation; landmark j, counted from 0, begins at mu[3 + 2 * j]"
            raise UserCodeError(f"step {self._step}: landmark {j} was seen, but {where} is still zero; {remedy}")

    def _motion_noise(self, own: Any) -> Float:
        """Return the noise (n, n) of the motion in the world frame: that of the recording, or that of the file."""
        increment = increment_cov(self._recording, self._step)
        whole = world_cov(self._recording, self._step, self._heading)
        rest = np.zeros([max(0, np.shape(own)[0] - ROBOT)] * 2) if np.ndim(own) == 2 else np.zeros((0, 0))
        return self._chosen("motion noise", own, increment, block_diagonal(whole, rest))

    def _observation_noise(self, own: Any) -> Float:
        """Return the noise of ranges and bearings in turn: that of the recording, or that of the file.

        If the matrix of the file has other rows than the scan, all observations have the noise of its first one.
        """
        covs, pairs = self._scan_covs, (np.shape(own) or (0,))[0] // 2
        whole = block_diagonal(*(covs if pairs == len(covs) else [covs[0]] * pairs))
        return self._chosen("observation noise", own, covs[0], whole)

    def _chosen(self, name: str, own: Any, given: Float, whole: Float) -> Float:
        """Return `whole` or the noise of the file, and remember both."""
        if np.shape(own) != whole.shape:
            self.noise_remarks[name] = f"its own {name} counts: it is not a matrix of this size"
            return own
        if name not in self.noise_remarks:
            first = np.asarray(own, np.float64)[: len(given), : len(given)]
            self.noise_remarks[name] = noise_remark(name, first, given, is_replaced=self._is_replaced)
            self.replaces_noise |= self._is_replaced and bool(self.noise_remarks[name])
        return whole if self._is_replaced else own
