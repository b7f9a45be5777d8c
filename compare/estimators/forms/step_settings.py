"""Settings of a step function: DT, KNOWN_DATA_ASSOCIATION, M_DIST_TH and its noise, globals or parameters.

The exercise has Q (2, 2), noise of u, and Py (2, 2), noise of an observation. PythonRobotics has Cx (3, 3), noise of
the pose in a step in the world frame; the only covariance (2, 2) that the function reads is that of an observation.

The recording's values replace those of the file. The remarks of the run name every replaced value. These are kept:

* KNOWN_DATA_ASSOCIATION = 0: the function gets no ids and associates on its own;
* M_DIST_TH. In a file with Cx it fits the noise of the file only: 13.8 replaces it where that noise is replaced;
* the noise of the file if it is requested;
* noise under other names, and a Cx that is the noise of observations, too: no recording has such noise.

The source of the function shows the globals that it reads, columns of a bearing-only y, and starts of passed values.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Iterator
from contextlib import suppress
from copy import deepcopy
from inspect import Parameter
from types import CodeType, FunctionType
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.signatures import Callee, Noise, parameters
from slamgauge.compare.estimators.user_errors import UserCodeError
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import rotation
from slamgauge.validation import REAL

STATE_AND_INPUT = 4  # parameters that every variant has
KNOWN_IDS = "KNOWN_DATA_ASSOCIATION"
DISTANCE = "M_DIST_TH"  # squared Mahalanobis distance
WIDE_DISTANCE = 13.8  # one correct observation in a thousand has a larger distance
EXERCISE, POSE = ("Q", "Py"), "Cx"
SETTINGS = ("DT", *EXERCISE, KNOWN_IDS, DISTANCE)
IDS = "trueLandmarkId"  # list of ids, empty at the start, in files of the exercise
CLOSE = 1e-3  # largest relative difference of equal settings


class Settings:
    """Settings of a step function, in the globals `space` of its module, and the recording that replaces them.

    y has `columns` columns, with ids if `shows_ids`. `replaces_noise`: the noise of the recording replaces another one
    of the file. A setting without a value is refused.
    """

    def __init__(self, function: Callee, recording: Recording, noise: Noise) -> None:
        self.space: dict[str, Any] = getattr(function, "__globals__", {})
        self._function, self._recording, read = function, recording, names_read(function)
        self._parameters = {each.name: each.default for each in parameters(function)[STATE_AND_INPUT:]}
        defaults = {name: each for name, each in self._parameters.items() if each is not Parameter.empty}
        given = {name: each for name, each in {**defaults, **self.space}.items() if name in SETTINGS}
        given |= {name: self.space[name] for name in read if _is_covariance(self.space.get(name))}
        self._file: dict[str, Any] = deepcopy(given)
        self.columns = 3 if recording.observation.shape[1] == 2 else _columns_of_bearings(function, given.get("Py"))
        self._used = {*self.space, *self._parameters}
        self._motion, self._observation = EXERCISE
        if self._observation not in self._used and np.shape(self._file.get(POSE, 0)) == (3, 3):
            others = [name for name in given if name in read and np.shape(given[name]) == (2, 2)]
            self._motion, self._observation = POSE, others[0] if len(others) == 1 else ""
        self._replaced = set[str]()
        if noise == "recording" and self._observation:
            self._replaced = {self._motion, self._observation} & self._used
        if self._motion != POSE and np.shape(self._file.get(self._motion, 0)) == (3, 3):
            self._replaced.discard(self._motion)  # it is not the noise of u
        self.replaces_noise = any(self._noise_remark(name) for name in self._replaced)
        self._reads_known = KNOWN_IDS in read or KNOWN_IDS in self._parameters
        is_known = self._file.get(KNOWN_IDS, True) if self._reads_known else DISTANCE not in read
        self.shows_ids = recording.landmark is not None and bool(is_known)
        self._replaces_distance = POSE in self._replaced and DISTANCE in self._file
        if self._replaces_distance:
            self.space[DISTANCE] = WIDE_DISTANCE
        if IDS in read:
            self.space.setdefault(IDS, [])
        known = {"DT", KNOWN_IDS, *self._replaced, *self.space}
        for name, default in self._parameters.items():
            if name in SETTINGS and name not in known and default is Parameter.empty:
                raise UserCodeError(f"no global has the value of its parameter {name}; give it a default")

    def named(self) -> dict[str, Any]:
        """Return arguments for parameters that have the name of a setting or global; containers are not settings."""
        found = {name: self.space[name] for name in self._parameters if name in self.space}
        return {
            name: each for name, each in found.items() if name in SETTINGS or not isinstance(each, list | dict | set)
        }

    def passed_at_first(self) -> dict[str, Any]:
        """Return the start of the values that the function returns after state and covariance and takes again, by name.

        It is the default of the parameter, a global of its name, or the value with which the file calls the function.
        """
        rest = [pair for pair in enumerate(parameters(self._function)) if pair[0] >= STATE_AND_INPUT]
        rest = [(number, each) for number, each in rest if each.name not in (*SETTINGS, *self.named())]
        found: dict[str, Any] = {}
        for number, each in [pair for pair in rest if pair[1].default is pair[1].empty] or rest[:1]:
            if each.default is not each.empty:
                starts = [each.default]
            elif each.name in self.space:
                starts = [self.space[each.name]]
            elif not (starts := _starts_where_called(self._function, number)):
                what = f"its parameter {each.name} has no value at the start"
                raise UserCodeError(f"{what}; give it a default, or write a global {each.name} = ... in the file")
            found[each.name] = starts[0]
        return found

    def set(self, step: int, scan: Observations, heading: float) -> None:
        """Set the globals of a step that begins at a heading [rad]; step 0 has no motion."""
        self.space["DT"] = step_length(self._recording, step)
        if KNOWN_IDS in self._used:
            self.space[KNOWN_IDS] = int(self.shows_ids)
        if self._motion in self._replaced:
            self.space[self._motion] = self._motion_cov(step, heading) * (step > 0)
        elif np.shape(self._file.get(self._motion, 0)) in ((2, 2), (3, 3)):
            is_of_observations = not self._observation  # also at step 0
            self.space[self._motion] = self._file[self._motion] * (step > 0 or is_of_observations)
        if self._observation in self._replaced and len(scan.value):
            self.space[self._observation] = self._observation_cov(step, scan)

    def _motion_cov(self, step: int, heading: float) -> Float:
        """Return the covariance (2, 2) of speed and yaw rate, or (3, 3) of the motion in the world frame."""
        cov: Float = self._recording.odometry_cov[max(step, 1) - 1] if self._recording.steps else np.zeros((3, 3))
        if self._motion != POSE:
            return cov[np.ix_([0, 2], [0, 2])] / step_length(self._recording, step) ** 2
        turn = np.eye(3)
        turn[:2, :2] = rotation(heading)
        return turn @ cov @ turn.T

    def _observation_cov(self, step: int, scan: Observations) -> Float:
        """Return the covariance of an observation; a bearing-only recording keeps the file's variance of ranges."""
        given: Float = scan.cov[0]
        if not (scan.cov == given).all():
            what = f"step {step}: observations of one scan have different noise"
            raise UserCodeError(f"{what}, which one {self._observation} cannot express; take its own, --noise file")
        cov = numbers(self._file.get(self._observation, given))
        if cov.size == 1 and cov > 0:
            if len(given) == 1:
                return given.reshape(cov.shape).copy()
            what = f"its {self._observation} is one variance, that of bearings, and this recording has ranges"
            remedy = f"use `study` or `grade` on q4-ring, or write {self._observation} of {len(given)} rows"
            raise UserCodeError(f"{what}, as those of `check` have; {remedy}")
        if cov.ndim != 2 or len({*cov.shape}) != 1 or len(cov) < len(given):
            what = f"its {self._observation} must be a square matrix of at least {len(given)} rows"
            raise UserCodeError(f"{what}, for the noise of an observation; mend it, or take its own, --noise file")
        cov[-len(given) :, -len(given) :] = given
        return cov

    def remarks(self) -> Iterator[str]:
        """Yield a sentence for each setting of the file that is replaced, or kept against the recording."""
        own, given = self._file.get("DT"), step_length(self._recording, 1)
        if isinstance(own, int | float) and abs(own - given) > CLOSE * given:
            yield f"DT of the file, {own:g} s, is replaced by the recording's, {given:.4g} s"
        known = self._file.get(KNOWN_IDS)
        if self._recording.landmark is None and known and self._reads_known:
            yield f"{KNOWN_IDS} of the file, {known}, is replaced by 0: the recording has no ids"
        if self._recording.landmark is not None and not self.shows_ids:
            why = f"{KNOWN_IDS} is 0" if self._reads_known else f"it uses {DISTANCE} and not {KNOWN_IDS}"
            what = "associates on its own and gets no ids"
            yield f"{what}, since {why} in the file; its map has no ids and is not graded"
        yield from filter(None, map(self._noise_remark, (self._motion, self._observation)))
        missing = [name for name in (self._motion, self._observation) if name and name not in self._used]
        if missing:
            yield f"noise of its own: the file has no {' and no '.join(missing)}"
        if not self._observation:
            what = f"{POSE} of the file, {_shown(self._file[POSE])}, is kept"
            yield f"{what}: it is the noise of motion and of observations, and no recording has such noise"
        if self._replaces_distance:
            why = f"that of the file fits its {POSE}, which is replaced"
            yield f"{DISTANCE} of the file, {self._file[DISTANCE]}, is replaced by {WIDE_DISTANCE}: {why}"

    def _noise_remark(self, name: str) -> str:
        """Compare a covariance of the file with that of the recording; return an empty text if they are equal."""
        own, recording, is_motion = self._file.get(name), self._recording, name == self._motion
        if own is None or not self._observation or not (recording.steps if is_motion else len(recording.observation)):
            return ""
        given = self._motion_cov(1, heading=0.0) if is_motion else recording.observation_cov[0]
        values = np.atleast_2d(numbers(own))
        if values.shape == (2, 2) and len(given) == 1:
            values = values[-1:, -1:]
        hint = ""
        if values.shape == given.shape:
            if np.allclose(values, given, rtol=CLOSE, atol=1e-12 * abs(given).max()):
                return ""
            is_root = np.allclose(values, np.sqrt(abs(given)), rtol=CLOSE, atol=0.0)
            hint = ": it has standard deviations, a square is missing" if is_root else ""
        hint += " (body frame)" if name == POSE else ""
        if name in self._replaced:
            return f"{name} of the file, {_shown(own)}, is replaced by the recording's, {_shown(given)}{hint}"
        return f"assumes {name} of the file, {_shown(own)}, where the recording has {_shown(given)}{hint}"


def step_length(recording: Recording, step: int) -> float:
    """Return the length of a step [s]; a scan at step 0 has that of step 1."""
    last = min(max(step, 1), recording.steps)
    return float(recording.stamps[last] - recording.stamps[last - 1]) if last else 1.0


def _is_covariance(value: object) -> bool:
    return isinstance(value, np.ndarray) and value.shape in ((1, 1), (2, 2), (3, 3))


def numbers(value: object) -> Float:
    """Copy an array of real numbers; return an empty array for anything else."""
    try:
        given = np.asarray(value)
    except ValueError:
        return np.zeros(0)
    return given.astype(np.float64) if given.dtype.kind in REAL else np.zeros(0)


def _shown(value: object) -> str:
    """Return a matrix in few characters, `diag(0.09, 0.0027)` if it is diagonal."""
    array = numbers(value)
    if not array.size:
        return repr(value)[:40]
    if array.ndim == 2 and len({*array.shape}) == 1 and not (array - np.diag(np.diag(array))).any():
        return f"diag({', '.join(f'{each:.3g}' for each in np.diag(array))})"
    return np.array2string(array, precision=3, separator=", ").replace("\n", "")


def names_read(function: Callee) -> set[str]:
    """Return the global names that a function and the functions of its module that it calls read."""
    space: dict[str, Any] = getattr(function, "__globals__", {})
    waiting, found = [getattr(function, "__code__", None)], set[CodeType]()
    while waiting:
        code = waiting.pop()
        if isinstance(code, CodeType) and code not in found:
            found.add(code)
            called = [space.get(name) for name in code.co_names]
            waiting += [*code.co_consts, *(each.__code__ for each in called if isinstance(each, FunctionType))]
    return {name for each in found for name in each.co_names}


def _columns_of_bearings(function: Callee, Py: Any) -> int:
    """Return the columns of y for bearings: by the highest column that the code reads, or else by the rows of Py."""
    name = parameters(function)[STATE_AND_INPUT - 1].name
    read = max((_last_column(node, name) for node in ast.walk(_tree(function))), default=0)
    if read:
        return 3 if read > 1 else 2
    return 3 if np.shape(Py)[:1] == (2,) else 2


def _last_column(node: ast.AST, name: str) -> int:
    """Return the highest column that `name[i, column]` or `name[i, a:b]` reads; 0 for other nodes."""
    if not isinstance(node, ast.Subscript) or not isinstance(node.value, ast.Name) or node.value.id != name:
        return 0
    column = node.slice.elts[1] if isinstance(node.slice, ast.Tuple) and len(node.slice.elts) == 2 else None
    end = column.upper if isinstance(column, ast.Slice) else column
    value = end.value if isinstance(end, ast.Constant) else 0
    return value - isinstance(column, ast.Slice) if isinstance(value, int) else 0


def _starts_where_called(function: Callee, number: int) -> list[Any]:
    """Return the value of the parameter `number` where the file calls the function; an empty list if it is not found.

    The value is a literal, for example `[]`, or a variable that the calling function has assigned one before.
    """
    whole, name = _tree(inspect.getmodule(function)), getattr(function, "__name__", "")
    for scope in (*(each for each in ast.walk(whole) if isinstance(each, ast.FunctionDef)), whole):
        for call in ast.walk(scope):
            if isinstance(call, ast.Call) and ast.unparse(call.func) == name and len(call.args) > number:
                given = call.args[number]
                found = _assigned(scope, given.id, call.lineno) if isinstance(given, ast.Name) else given
                with suppress(ValueError):  # no literal, or none is assigned
                    return [ast.literal_eval(found or given)]
    return []


def _assigned(scope: ast.AST, name: str, before: int) -> ast.expr | None:
    """Return the first expression that a function assigns to a name alone above a line."""
    for node in ast.walk(scope):
        names = [each.id for each in getattr(node, "targets", []) if isinstance(each, ast.Name)]
        if isinstance(node, ast.Assign) and node.lineno < before and name in names:
            return node.value
    return None


def _tree(given: object) -> ast.AST:
    """Parse the source of a function or module; return an empty module if Python does not find it."""
    try:
        return ast.parse(textwrap.dedent(inspect.getsource(given)))  # pyrefly: ignore[bad-argument-type]
    except (OSError, TypeError, SyntaxError):
        return ast.Module([], [])
