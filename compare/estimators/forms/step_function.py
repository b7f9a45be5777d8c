"""Step functions of the exercise and of PythonRobotics: `ekf_slam(xEst, PEst, u, y) -> xEst, PEst`.

State (3+2n, 1), u (2, 1) = speed [m/s] and yaw rate [rad/s], y (m, 3) = range [m], bearing [rad], id. The function
reads globals of its module: DT [s], Q (2, 2) of u, Py (2, 2), KNOWN_DATA_ASSOCIATION (`step_settings`). An increment
(dx, 0, dtheta) with covariance C over DT is exactly u = (dx, dtheta) / DT with Q = C / DT^2.

Variants take settings, and other globals of their modules, as parameters of those names. Bearing-only variants take and
return a third value (rays and their weights), and y = [bearing, id], or [range, bearing, id] with a range of NaN.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.addresses import Noise
from slamgauge.compare.estimators.forms.columns import column
from slamgauge.compare.estimators.forms.signatures import Callee, Form, parameters, required
from slamgauge.compare.estimators.forms.state_log import StateLog
from slamgauge.compare.estimators.forms.step_settings import SETTINGS, STATE_AND_INPUT, StepSettings, step_length
from slamgauge.compare.estimators.forms.step_source import (
    names_read,
    starts_where_called,
    step_length_hint,
    width_of_bearings,
)
from slamgauge.compare.estimators.user_errors import UserCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.sensors import SENSORS

PLAIN = (bool, int, float, complex, str, type(None), np.ndarray, np.generic)  # types of globals that start as they were


def is_step_function(given: object) -> bool:
    """Return whether a callable has the parameters of a step function."""
    return callable(given) and not isinstance(given, type) and len(required(given)) >= STATE_AND_INPUT


def lacks(given: Callee) -> str:
    """Return what a callable with the parameters of a step function lacks; empty if it is one."""
    if "DT" in names_read(given) or "DT" in (each.name for each in parameters(given)):
        return ""
    hint = step_length_hint(given)
    return f"DT, the length of a step [s], which it reads nowhere{f'; {hint}' if hint else ''}"


@dataclass
class StepFunction(Form):
    """A step function as an estimator; every run finds the globals of its module as they were before.

    Attributes:
        function: the function.
        noise: assumed noise: that of the recording, or that of its file.
    """

    function: Callee
    noise: Noise = "recording"

    def __post_init__(self) -> None:
        names = ", ".join(each.name for each in parameters(self.function))
        self.words = f"step function of the exercise ({names})"

    def __call__(self, recording: Recording) -> Estimate:
        """Run the function over a recording; for a scan at step 0, u and Q are zero.

        Raises:
            UserCodeError: u, y and globals cannot express the recording, or the function returns no state.
        """
        _require_expressible(recording)
        space: dict[str, Any] = getattr(self.function, "__globals__", {})
        before = dict(space)
        space.update({name: deepcopy(value) for name, value in before.items() if _is_data(value)})
        try:
            return self._run(recording)
        finally:
            space.update(before)
            for name in space.keys() - before.keys():
                del space[name]

    def _run(self, recording: Recording) -> Estimate:
        settings, log = StepSettings(self.function, recording, self.noise), StateLog(recording)
        self.remarks, self.replaces_noise = settings.remarks(), settings.replaces_noise
        rest = [each for each in parameters(self.function)[STATE_AND_INPUT:] if each.name not in SETTINGS]
        shared = [each.name for each in rest if _is_setting(each.name, settings.space)]
        passed = _first_values(self.function, shared, settings.space)
        width = 3
        if recording.observation.shape[1] == 1:
            width = width_of_bearings(self.function, STATE_AND_INPUT - 1, settings.observation_cov)
        x: Any = recording.prior_mean.reshape(3, 1).copy()
        P: Any = recording.prior_cov.copy()
        for step, scan in enumerate(recording.scans()):
            if step == 0 and not len(scan.value):
                continue
            settings.set(step, scan, heading=float(np.asarray(x).flat[2]))
            named = settings.named() | {name: settings.space[name] for name in shared} | passed
            ids = scan.landmark if settings.shows_ids else None
            u, y = column(_input(recording, step)), column(_observed(scan, ids is not None, width))
            start = perf_counter()
            returned = self.function(column(x), column(P), u, y, **named)
            seconds = perf_counter() - start
            if not isinstance(returned, tuple | list) or len(returned) < 2:
                kind = type(returned).__name__
                raise UserCodeError(f"the step function returned a {kind}; return state and covariance")
            x, P, *more = returned
            log.add(step, (x, P), ids, seconds)
            passed = _passed_on(self.function, passed, more)
        return log.estimate()


def _first_values(function: Callee, shared: list[str], space: dict[str, Any]) -> dict[str, Any]:
    """Return the start of the values that the function returns after state and covariance and takes again, by name.

    It is the default of the parameter, a global of its name, or the value with which the file calls the function.

    Raises:
        UserCodeError: none of these exists.
    """
    rest = [(number, each) for number, each in enumerate(parameters(function)) if number >= STATE_AND_INPUT]
    rest = [(number, each) for number, each in rest if each.name not in (*SETTINGS, *shared)]
    found: dict[str, Any] = {}
    for number, each in [pair for pair in rest if pair[1].default is pair[1].empty] or rest[:1]:
        starts = [each.default] if each.default is not each.empty else []
        starts = starts or ([space[each.name]] if each.name in space else starts_where_called(function, number))
        if not starts:
            what = f"its parameter {each.name} has no value at the start"
            raise UserCodeError(f"{what}; give it a default, or write a global {each.name} = ... in the file")
        found[each.name] = starts[0]
    return found


def _passed_on(function: Callee, passed: dict[str, Any], returned: list[Any]) -> dict[str, Any]:
    """Return the values of the next step: those that the function returned, or if it returned none those before."""
    needed = [name for name in passed if name in required(function)]
    if 0 < len(returned) < len(needed):
        what = "only one value can" if len(returned) == 1 else f"only {len(returned)} values can"
        raise UserCodeError(f"parameters {', '.join(needed)}: {what} be passed on from step to step")
    return passed | dict(zip(passed, returned, strict=False))


def _is_setting(name: str, space: dict[str, Any]) -> bool:
    """Return whether a parameter has a global of its name; lists, dicts and sets are passed on from step to step."""
    return name in space and not isinstance(space[name], list | dict | set)


def _is_data(value: object) -> bool:
    """Return whether a value consists of numbers, texts and arrays."""
    if isinstance(value, dict):
        return all(_is_data(each) for pair in value.items() for each in pair)
    if isinstance(value, list | tuple | set | frozenset):
        return all(map(_is_data, value))
    return isinstance(value, PLAIN)


def _input(recording: Recording, step: int) -> Float:
    """Return the control u (2, 1): speed [m/s], yaw rate [rad/s]."""
    if step == 0:
        return np.zeros((2, 1))
    return recording.odometry[step - 1, [0, 2]].reshape(2, 1) / step_length(recording, step)


def _observed(scan: Observations, shows_ids: bool, width: int) -> Float:
    """Return the scan as y (m, 3) or (m, 2): unknown ranges are NaN, unknown ids in the last column are -1."""
    ids = scan.landmark if shows_ids and scan.landmark is not None else np.full(len(scan.value), -1)
    y = np.column_stack([scan.value, ids.astype(np.float64)])
    return np.hstack([np.full((len(y), width - y.shape[1]), np.nan), y])


def _require_expressible(recording: Recording) -> None:
    """Refuse a recording that u and y cannot express."""
    if not SENSORS[recording.sensor].has_bearing:
        raise UserCodeError("a step function of the exercise takes ranges and bearings; this recording has positions")
    sideways = np.flatnonzero(recording.odometry[:, 1])
    if len(sideways):
        step, slip = sideways[0] + 1, recording.odometry[sideways[0], 1]
        what = f"step {step} moves {slip:.3g} m sideways, which u = [speed, yaw rate] cannot express"
        raise UserCodeError(f"{what}; bring another form, an online class for instance")
