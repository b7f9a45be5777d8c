"""The step function of the practical: `ekf_slam(xEst, PEst, u, y) -> xEst, PEst`.

State (3+2n, 1), u (2, 1) = speed [m/s] and yaw rate [rad/s], y (m, 3) = range [m], bearing [rad], id. What else it
knows stands in globals of its module: DT [s], Q (2, 2) of u, Py (2, 2), KNOWN_DATA_ASSOCIATION. An increment
(dx, 0, dtheta) with covariance C over DT is u = (dx, dtheta) / DT with Q = C / DT^2, exactly.

Copies differ. Some take settings as parameters of those names; those for bearings alone take and return a third value
(rays, their weights), and y = [bearing, id], or still [range, bearing, id].
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.fresh_modules import Code, Fresh
from slamgauge.compare.estimators.signatures import called, pair, parameters, required
from slamgauge.compare.estimators.state_log import Trail
from slamgauge.compare.estimators.user_code import Callee, OwnCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.sensors import SENSORS

Noise = Literal["recording", "file"]
STATE_AND_INPUT = 4  # parameters that every copy has
NOISES = ("Q", "Py")
SETTINGS = ("DT", *NOISES, "KNOWN_DATA_ASSOCIATION", "M_DIST_TH")
WRAPPER = 'slamgauge.adapters.step_function(ekf_slam, noise="file")'


def description(given: Fresh) -> str | None:
    """What people are told of a callable of this form; None for another."""
    if len(required(given.callee)) < STATE_AND_INPUT or inspect.isclass(given.callee):
        return None
    return f"step function of the practical ({', '.join(each.name for each in parameters(given.callee))})"


@dataclass(frozen=True)
class StepFunction:
    """A step function as an estimator.

    Attributes:
        code: where the function comes from.
        noise: whose noise it assumes: the recording's, or what its file says of Q and Py.
    """

    code: Code
    noise: Noise = "recording"

    def __call__(self, recording: Recording) -> Estimate:
        """Run it over a recording; the first scan is fed with u = 0 and Q = 0.

        Raises:
            OwnCodeError: it cannot be told what the recording says, or returns no state.
        """
        _require_expressible(recording)
        trail = Trail(recording)
        with self.code.fresh() as fresh:
            told = _Told(fresh.callee, recording, self.noise)
            for step, scan in enumerate(recording.scans()):
                if step > 0 or len(scan.value):
                    trail.step(step, scan.landmark, told.advance_by(step, scan))
        return trail.estimate()


class _Told:
    """A step function on its way through a recording, and its globals.

    Args:
        function: the step function, fresh.
        recording: what it is fed.
        noise: see `StepFunction`.
    """

    def __init__(self, function: Callee, recording: Recording, noise: Noise) -> None:
        self._function, self._recording, self._noise = function, recording, noise
        self._globals: dict[str, Any] = getattr(function, "__globals__", {})
        self._rest = parameters(function)[STATE_AND_INPUT:]
        self._require_settings()
        self._carrier = self._carrier_among(self._rest)
        self._file_noise = {name: np.array(self._globals[name], float) for name in NOISES if name in self._globals}
        self._x: object = recording.prior_mean.reshape(3, 1).copy()
        self._P: object = recording.prior_cov.copy()
        self._carried = self._first_carried()
        self._y_width = _width_of_y(function, recording, self._file_noise.get("Py"))

    def advance_by(self, step: int, scan: Observations) -> Any:
        """What takes the function over one step, for `Trail.step`."""
        self._set(step, scan)
        u, y = self._input(step), self._observations(scan)

        def advance() -> tuple[object, object]:
            bound = partial(self._function, **self._named())
            returned = pair(called(bound, np.array(self._x), np.array(self._P), u, y), "the step function")
            self._x, self._P, *carried = returned
            if carried:
                self._carried = carried[0]
            return self._x, self._P

        return advance

    def _set(self, step: int, scan: Observations) -> None:
        """Write the globals for a step."""
        self._globals["DT"] = self._dt(step)
        if "KNOWN_DATA_ASSOCIATION" in self._globals or self._takes("KNOWN_DATA_ASSOCIATION"):
            self._globals["KNOWN_DATA_ASSOCIATION"] = int(self._recording.landmark is not None)
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
            what = f"step {step}: observations of one scan have different noise, which one Py cannot say"
            raise OwnCodeError(f"{what}; take its own, {WRAPPER}")
        given: Float = scan.cov[0]
        Py = np.array(self._file_noise.get("Py", given))
        if Py.ndim != 2 or len(Py) != Py.shape[1] or len(Py) < len(given):
            what = f"its Py is no square matrix of at least {len(given)} rows, to put an observation's noise in"
            raise OwnCodeError(f"{what}; mend it, or take its own, {WRAPPER}")
        Py[-len(given) :, -len(given) :] = given  # of bearings alone: the last of the file's
        self._globals["Py"] = Py

    def _input(self, step: int) -> Float:
        """The control u (2, 1): speed [m/s], yaw rate [rad/s]."""
        if step == 0:
            return np.zeros((2, 1))
        return self._recording.odometry[step - 1, [0, 2]].reshape(2, 1) / self._dt(step)

    def _observations(self, scan: Observations) -> Float:
        """The scan y (m, 3) or (m, 2), its last column the id, -1 where unknown; a range that nobody knows is NaN."""
        ids = np.full(len(scan.value), -1) if scan.landmark is None else scan.landmark
        y = np.column_stack([scan.value, ids])
        unknown = np.full((len(y), self._y_width - y.shape[1]), np.nan)
        return np.hstack([unknown, y])

    def _dt(self, step: int) -> float:
        """[s]; the first scan's is that of the first step."""
        stamps = self._recording.stamps
        last = min(max(step, 1), len(stamps) - 1)
        return float(stamps[last] - stamps[last - 1]) if last else 1.0

    def _named(self) -> dict[str, object]:
        """What the parameters after y are given: settings, and what was returned for the next step."""
        settings = {each.name: self._globals[each.name] for each in self._rest if each.name in self._settings()}
        return settings if self._carrier is None else {**settings, self._carrier.name: self._carried}

    def _settings(self) -> set[str]:
        """Names of settings that have a value."""
        told = {"DT", "KNOWN_DATA_ASSOCIATION", *(NOISES if self._noise == "recording" else ())}
        return {name for name in SETTINGS if name in told or name in self._globals}

    def _takes(self, name: str) -> bool:
        return any(each.name == name for each in self._rest)

    def _require_settings(self) -> None:
        """Refuse a function that would not notice what it is told, or that waits for what nobody knows."""
        needed = ("DT", *(NOISES if self._noise == "recording" else ()))
        lacking = [name for name in needed if name not in self._globals and not self._takes(name)]
        if lacking:
            remedy = f"call them so, or take its own noise, {WRAPPER}" if "DT" not in lacking else "let it read them"
            raise OwnCodeError(f"has no global {' and no '.join(lacking)}; {remedy}")
        for each in self._rest:
            if each.name in SETTINGS and each.name not in self._settings() and each.default is each.empty:
                raise OwnCodeError(f"no global has the value of its parameter {each.name}; give it a default")

    def _carrier_among(self, rest: list[inspect.Parameter]) -> inspect.Parameter | None:
        """The parameter that takes the third value returned the step before."""
        others = [each for each in rest if each.name not in SETTINGS]
        waiting = [each for each in others if each.default is each.empty]
        if len(waiting) > 1:
            names = ", ".join(each.name for each in waiting)
            raise OwnCodeError(f"parameters {names}: only one value can be passed on from step to step")
        return next(iter([*waiting, *others]), None)

    def _first_carried(self) -> object:
        """The third value at the start: its parameter's default, the global of its name, or an empty list."""
        if self._carrier is None or self._carrier.default is not self._carrier.empty:
            return self._carrier and self._carrier.default
        return self._globals.get(self._carrier.name, [])


def _require_expressible(recording: Recording) -> None:
    """Refuse what u and y cannot say."""
    if not SENSORS[recording.sensor].has_bearing:
        raise OwnCodeError("a step function of the practical takes ranges and bearings; this recording has positions")
    sideways = np.flatnonzero(recording.odometry[:, 1])
    if len(sideways):
        step, slip = sideways[0] + 1, recording.odometry[sideways[0], 1]
        what = f"step {step} moves {slip:.3g} m sideways, which u = [speed, yaw rate] cannot say"
        raise OwnCodeError(f"{what}; bring another form, an online class for instance")


def _width_of_y(function: Callee, recording: Recording, Py: Float | None) -> int:
    """How many columns its y has: its code tells, by the highest that it reads; otherwise the size of Py does."""
    dim = recording.observation.shape[1]
    if dim == 2:
        return 3
    name = parameters(function)[STATE_AND_INPUT - 1].name
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError):
        tree = ast.Module([], [])
    read = [_last_column(node) for node in ast.walk(tree) if _is_of(node, name)]
    if max(read, default=0):
        return 3 if max(read) > 1 else 2
    return 3 if Py is not None and len(Py) == 2 else 2


def _is_of(node: ast.AST, name: str) -> bool:
    return isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id == name


def _last_column(node: ast.AST) -> int:
    """The highest column that `y[i, column]` or `y[i, a:b]` reads; 0 where that cannot be seen."""
    place = node.slice if isinstance(node, ast.Subscript) else None
    column = place.elts[1] if isinstance(place, ast.Tuple) and len(place.elts) == 2 else None
    end = column.upper if isinstance(column, ast.Slice) else column
    value = end.value if isinstance(end, ast.Constant) else 0
    return value - isinstance(column, ast.Slice) if isinstance(value, int) else 0
