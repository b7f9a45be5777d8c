"""Step functions of the exercise: `ekf_slam(xEst, PEst, u, y) -> xEst, PEst`.

State (3+2n, 1), u (2, 1) = speed [m/s] and yaw rate [rad/s], y (m, 3) = range [m], bearing [rad], id. The function
reads globals of its module: DT [s], Q (2, 2) of u, Py (2, 2), KNOWN_DATA_ASSOCIATION. An increment (dx, 0, dtheta) with
covariance C over DT is exactly u = (dx, dtheta) / DT with Q = C / DT^2.

Variants take settings as parameters of those names. Bearing-only variants take and return a third value (rays and their
weights), and y = [bearing, id], or [range, bearing, id] with a range of NaN.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.signatures import called, pair, parameters, required
from slamgauge.compare.estimators.forms.state_log import StateLog
from slamgauge.compare.estimators.fresh_modules import Code, Fresh
from slamgauge.compare.estimators.user_code import Callee, Noise, UserCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.sensors import SENSORS

STATE_AND_INPUT = 4  # parameters that every variant has
NOISES = ("Q", "Py")
KNOWN = "KNOWN_DATA_ASSOCIATION"
SETTINGS = ("DT", *NOISES, KNOWN, "M_DIST_TH")
WRAPPER = 'slamgauge.adapters.step_function(ekf_slam, noise="file")'


def description(given: Fresh) -> str | None:
    """Describe a step function; return None for anything else."""
    if len(required(given.callee)) < STATE_AND_INPUT or inspect.isclass(given.callee):
        return None
    return f"step function of the exercise ({', '.join(each.name for each in parameters(given.callee))})"


@dataclass(frozen=True)
class StepFunction:
    """A step function as an estimator.

    Attributes:
        code: source of the function.
        noise: assumed noise: that of the recording, or Q and Py of its file.
    """

    code: Code
    noise: Noise = "recording"

    def __call__(self, recording: Recording) -> Estimate:
        """Run the function over a recording; for a scan at step 0, u and Q are zero.

        Raises:
            UserCodeError: u, y and globals cannot express the recording, or the function returns no state.
        """
        _require_expressible(recording)
        log = StateLog(recording)
        with self.code.fresh() as fresh:
            stepper = _Stepper(fresh.callee, recording, self.noise)
            for step, scan in enumerate(recording.scans()):
                if step > 0 or len(scan.value):
                    log.step(step, scan.landmark, stepper.advance_by(step, scan))
        return log.estimate()


class _Stepper:
    """A step function with its globals and the state that it returned last."""

    def __init__(self, function: Callee, recording: Recording, noise: Noise) -> None:
        self._function, self._recording, self._noise = function, recording, noise
        self._globals: dict[str, Any] = getattr(function, "__globals__", {})
        self._rest = parameters(function)[STATE_AND_INPUT:]
        self._require_settings()
        self._third_parameter = _third_among(self._rest)
        self._file_noise = {name: np.array(self._globals[name], float) for name in NOISES if name in self._globals}
        self._x: object = recording.prior_mean.reshape(3, 1).copy()
        self._P: object = recording.prior_cov.copy()
        self._third = self._first_third()
        self._y_width = _width_of_y(function, recording, self._file_noise.get("Py"))

    def advance_by(self, step: int, scan: Observations) -> Any:
        """Set the globals and return a function that calls the step function, for `StateLog.step`."""
        self._set_globals(step, scan)
        u, y = self._input(step), self._observations(scan)

        def advance() -> tuple[object, object]:
            bound = partial(self._function, **self._named())
            returned = pair(called(bound, np.array(self._x), np.array(self._P), u, y), "the step function")
            self._x, self._P, *third = returned
            if third:
                self._third = third[0]
            return self._x, self._P

        return advance

    def _set_globals(self, step: int, scan: Observations) -> None:
        self._globals["DT"] = self._dt(step)
        if KNOWN in self._globals or any(each.name == KNOWN for each in self._rest):
            self._globals[KNOWN] = int(self._recording.landmark is not None)
        if self._noise == "recording":
            self._set_noise(step, scan)
        elif "Q" in self._file_noise:
            self._globals["Q"] = self._file_noise["Q"].copy()
        if step == 0 and "Q" in self._globals:
            self._globals["Q"] = np.zeros_like(self._globals["Q"])

    def _set_noise(self, step: int, scan: Observations) -> None:
        forward_and_turn = self._recording.odometry_cov[max(step, 1) - 1][np.ix_([0, 2], [0, 2])]
        self._globals["Q"] = forward_and_turn / self._dt(step) ** 2
        if not len(scan.value):
            return
        if not (scan.cov == scan.cov[0]).all():
            what = f"step {step}: observations of one scan have different noise, which one Py cannot express"
            raise UserCodeError(f"{what}; take its own, {WRAPPER}")
        given: Float = scan.cov[0]
        Py = np.array(self._file_noise.get("Py", given))
        if Py.ndim != 2 or len(Py) != Py.shape[1] or len(Py) < len(given):
            what = f"its Py must be a square matrix of at least {len(given)} rows, for the noise of an observation"
            raise UserCodeError(f"{what}; mend it, or take its own, {WRAPPER}")
        Py[-len(given) :, -len(given) :] = given  # a bearing-only recording keeps the file's variance of ranges
        self._globals["Py"] = Py

    def _input(self, step: int) -> Float:
        """Return the control u (2, 1): speed [m/s], yaw rate [rad/s]."""
        if step == 0:
            return np.zeros((2, 1))
        return self._recording.odometry[step - 1, [0, 2]].reshape(2, 1) / self._dt(step)

    def _observations(self, scan: Observations) -> Float:
        """Return the scan as y (m, 3) or (m, 2): unknown ranges are NaN, unknown ids in the last column are -1."""
        ids = np.full(len(scan.value), -1) if scan.landmark is None else scan.landmark
        y = np.column_stack([scan.value, ids])
        unknown = np.full((len(y), self._y_width - y.shape[1]), np.nan)
        return np.hstack([unknown, y])

    def _dt(self, step: int) -> float:
        """Return the length of a step [s]; a scan at step 0 has that of step 1."""
        stamps = self._recording.stamps
        last = min(max(step, 1), len(stamps) - 1)
        return float(stamps[last] - stamps[last - 1]) if last else 1.0

    def _named(self) -> dict[str, object]:
        """Return arguments for the parameters after y: settings, and the third value."""
        settings = {each.name: self._globals[each.name] for each in self._rest if each.name in self._known_settings()}
        return settings if self._third_parameter is None else {**settings, self._third_parameter.name: self._third}

    def _known_settings(self) -> set[str]:
        """Return the names of settings that have a value."""
        set_here = {"DT", KNOWN, *(NOISES if self._noise == "recording" else ())}
        return {name for name in SETTINGS if name in set_here or name in self._globals}

    def _require_settings(self) -> None:
        """Refuse a function that does not use what is set, or that needs a setting without a value."""
        needed = ("DT", *(NOISES if self._noise == "recording" else ()))
        used = {*self._globals, *(each.name for each in self._rest)}
        lacking = [name for name in needed if name not in used]
        if lacking:
            remedy = f"call them so, or take its own noise, {WRAPPER}" if "DT" not in lacking else "let it read them"
            raise UserCodeError(f"has no global {' and no '.join(lacking)}; {remedy}")
        for each in self._rest:
            if each.name in SETTINGS and each.name not in self._known_settings() and each.default is each.empty:
                raise UserCodeError(f"no global has the value of its parameter {each.name}; give it a default")

    def _first_third(self) -> object:
        """Return the third value at the start: default of its parameter, global of its name, or an empty list."""
        parameter = self._third_parameter
        if parameter is None:
            return None
        return self._globals.get(parameter.name, []) if parameter.default is parameter.empty else parameter.default


def _third_among(rest: list[inspect.Parameter]) -> inspect.Parameter | None:
    """Return the parameter that takes the third value returned by the step before."""
    others = [each for each in rest if each.name not in SETTINGS]
    without_default = [each for each in others if each.default is each.empty]
    if len(without_default) > 1:
        names = ", ".join(each.name for each in without_default)
        raise UserCodeError(f"parameters {names}: only one value can be passed on from step to step")
    return next(iter([*without_default, *others]), None)


def _require_expressible(recording: Recording) -> None:
    """Refuse a recording that u and y cannot express."""
    if not SENSORS[recording.sensor].has_bearing:
        raise UserCodeError("a step function of the exercise takes ranges and bearings; this recording has positions")
    sideways = np.flatnonzero(recording.odometry[:, 1])
    if len(sideways):
        step, slip = sideways[0] + 1, recording.odometry[sideways[0], 1]
        what = f"step {step} moves {slip:.3g} m sideways, which u = [speed, yaw rate] cannot express"
        raise UserCodeError(f"{what}; bring another form, an online class for instance")


def _width_of_y(function: Callee, recording: Recording, Py: Float | None) -> int:
    """Return the columns of y: for bearing-only recordings from the highest column that the code reads, or from Py."""
    if recording.observation.shape[1] == 2:
        return 3
    name = parameters(function)[STATE_AND_INPUT - 1].name
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError):
        tree = ast.Module([], [])
    read = max((_last_column(node, name) for node in ast.walk(tree)), default=0)
    if read:
        return 3 if read > 1 else 2
    return 3 if Py is not None and len(Py) == 2 else 2


def _last_column(node: ast.AST, name: str) -> int:
    """Return the highest column that `name[i, column]` or `name[i, a:b]` reads; 0 for other nodes."""
    if not isinstance(node, ast.Subscript) or not isinstance(node.value, ast.Name) or node.value.id != name:
        return 0
    column = node.slice.elts[1] if isinstance(node.slice, ast.Tuple) and len(node.slice.elts) == 2 else None
    end = column.upper if isinstance(column, ast.Slice) else column
    value = end.value if isinstance(end, ast.Constant) else 0
    return value - isinstance(column, ast.Slice) if isinstance(value, int) else 0
