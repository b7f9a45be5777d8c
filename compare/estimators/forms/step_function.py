"""Step functions of the exercise: `ekf_slam(xEst, PEst, u, y) -> xEst, PEst`.

State (3+2n, 1), u (2, 1) = speed [m/s] and yaw rate [rad/s], y (m, 3) = range [m], bearing [rad], id. The function
reads globals of its module: DT [s], Q (2, 2) of u, Py (2, 2), KNOWN_DATA_ASSOCIATION (`step_settings`). An increment
(dx, 0, dtheta) with covariance C over DT is exactly u = (dx, dtheta) / DT with Q = C / DT^2.

Variants take settings, and other globals of their modules, as parameters of those names. Bearing-only variants take and
return a third value (rays and their weights), and y = [bearing, id], or [range, bearing, id] with a range of NaN.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.columns import column, use_columns
from slamgauge.compare.estimators.forms.inputs import step_length
from slamgauge.compare.estimators.forms.signatures import ArrayForNumberError, called, pair, parameters, required
from slamgauge.compare.estimators.forms.state_log import StateLog
from slamgauge.compare.estimators.forms.step_settings import SETTINGS, STATE_AND_INPUT, StepSettings, is_setting
from slamgauge.compare.estimators.forms.step_source import is_a_dict, width_of_bearings
from slamgauge.compare.estimators.fresh_modules import Code, Fresh
from slamgauge.compare.estimators.user_code import Callee, Noise, UserCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.sensors import SENSORS


def description(given: Fresh) -> str | None:
    """Describe a step function; return None for anything else."""
    if len(required(given.callee)) < STATE_AND_INPUT or inspect.isclass(given.callee):
        return None
    return f"step function of the exercise ({', '.join(each.name for each in parameters(given.callee))})"


@dataclass
class StepFunction:
    """A step function as an estimator.

    Attributes:
        code: source of the function.
        noise: assumed noise: that of the recording, or Q and Py of its file.
        found: remarks on the last run.
        replaces_noise: whether the noise of the recording replaced another one of the file in the last run.
    """

    code: Code
    noise: Noise = "recording"
    found: list[str] = field(default_factory=list, compare=False, repr=False)
    replaces_noise: bool = field(default=False, init=False, compare=False, repr=False)

    def __call__(self, recording: Recording) -> Estimate:
        """Run the function over a recording; for a scan at step 0, u and Q are zero.

        If numpy refuses an array of one element as a number, the function runs again with columns (`columns`).

        Raises:
            UserCodeError: u, y and globals cannot express the recording, or the function returns no state.
        """
        _require_expressible(recording)
        try:
            return self._run(recording, array=lambda value: value)
        except ArrayForNumberError as error:
            estimate = self._run(recording, array=column)
            remedy = "its arrays of one element are converted to numbers"
            self.found.append(f"{error.what}, which numpy {np.__version__} refuses; {remedy}")
            return estimate

    def remarks(self, _recording: Recording) -> list[str]:
        """Return the remarks on the last run."""
        return [*self.found]

    def _run(self, recording: Recording, array: Callable[[Any], Any]) -> Estimate:
        log = StateLog(recording)
        with self.code.fresh() as fresh:
            if array is column:
                use_columns(getattr(fresh.callee, "__globals__", {}))
            stepper = _Stepper(fresh.callee, recording, self.noise, array)
            self.found[:] = stepper.settings.remarks()
            self.replaces_noise = stepper.settings.replaces_noise
            for step, scan in enumerate(recording.scans()):
                if step > 0 or len(scan.value):
                    ids = scan.landmark if stepper.settings.shows_ids else None
                    log.step(step, ids, stepper.advance_by(step, scan))
        return log.estimate()


class _Stepper:
    """A step function with its settings and the state that it returned last."""

    def __init__(self, function: Callee, recording: Recording, noise: Noise, array: Callable[[Any], Any]) -> None:
        self.settings = StepSettings(function, recording, noise)
        self._function, self._recording, self._array = function, recording, array
        rest = [each for each in parameters(function)[STATE_AND_INPUT:] if each.name not in SETTINGS]
        space = self.settings.space
        self._globals = [each.name for each in rest if is_setting(each, space)]
        self._passed_on = _passed_on([each for each in rest if each.name not in self._globals])
        self._values = {each.name: _first(function, each, space) for each in self._passed_on}
        self._x: object = recording.prior_mean.reshape(3, 1).copy()
        self._P: object = recording.prior_cov.copy()
        self._y_width = 3
        if recording.observation.shape[1] == 1:
            self._y_width = width_of_bearings(function, STATE_AND_INPUT - 1, self.settings.observation_cov)

    def advance_by(self, step: int, scan: Observations) -> Any:
        """Set the globals and return a function that calls the step function, for `StateLog.step`."""
        self.settings.set(step, scan, heading=float(np.asarray(self._x).flat[2]))
        space, array = self.settings.space, self._array
        matrix = np.asmatrix if self.settings.uses_matrices else np.asarray
        named = {name: array(value) for name, value in self.settings.named().items()}
        named |= {name: space[name] for name in self._globals}
        u, y = array(matrix(self._input(step))), array(matrix(self._observations(scan)))

        def advance() -> tuple[object, object]:
            bound = partial(self._function, **named, **self._values)
            x, P = array(matrix(np.array(self._x))), array(np.array(self._P))
            self._x, self._P, *third = pair(called(bound, x, P, u, y), "the step function")
            self._pass_on(third)
            return self._x, self._P

        return advance

    def _pass_on(self, returned: list[object]) -> None:
        """Store what the function returned after state and covariance, as arguments of the next step."""
        names = [*self._values]
        required_names = [each.name for each in self._passed_on if each.default is each.empty]
        if 0 < len(returned) < len(required_names):
            what = "only one value can" if len(returned) == 1 else f"only {len(returned)} values can"
            raise UserCodeError(f"parameters {', '.join(required_names)}: {what} be passed on from step to step")
        self._values.update(zip(names, returned, strict=False))

    def _input(self, step: int) -> Float:
        """Return the control u (2, 1): speed [m/s], yaw rate [rad/s]."""
        if step == 0:
            return np.zeros((2, 1))
        return self._recording.odometry[step - 1, [0, 2]].reshape(2, 1) / step_length(self._recording, step)

    def _observations(self, scan: Observations) -> Float:
        """Return the scan as y (m, 3) or (m, 2): unknown ranges are NaN, unknown ids in the last column are -1."""
        shown = scan.landmark if self.settings.shows_ids else None
        ids = np.full(len(scan.value), -1) if shown is None else shown
        y = np.column_stack([scan.value, ids.astype(np.float64)])
        unknown = np.full((len(y), self._y_width - y.shape[1]), np.nan)
        return np.hstack([unknown, y])


def _passed_on(rest: list[inspect.Parameter]) -> list[inspect.Parameter]:
    """Return the parameters that take the values returned after state and covariance; one of those with a default."""
    without_default = [each for each in rest if each.default is each.empty]
    return without_default or rest[:1]


def _first(function: Callee, parameter: inspect.Parameter, space: dict[str, Any]) -> object:
    """Return a value that is passed on, at the start: default of its parameter, global, or an empty list or dict."""
    if parameter.default is not parameter.empty:
        return parameter.default
    return space.get(parameter.name, {} if is_a_dict(function, parameter.name) else [])


def _require_expressible(recording: Recording) -> None:
    """Refuse a recording that u and y cannot express."""
    if not SENSORS[recording.sensor].has_bearing:
        raise UserCodeError("a step function of the exercise takes ranges and bearings; this recording has positions")
    sideways = np.flatnonzero(recording.odometry[:, 1])
    if len(sideways):
        step, slip = sideways[0] + 1, recording.odometry[sideways[0], 1]
        what = f"step {step} moves {slip:.3g} m sideways, which u = [speed, yaw rate] cannot express"
        raise UserCodeError(f"{what}; bring another form, an online class for instance")
