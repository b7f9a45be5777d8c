"""Noise of a step function: two covariances, globals or parameters of its file.

The exercise has Q (2, 2), noise of u, and Py (2, 2), noise of an observation. PythonRobotics has Cx (3, 3), noise of
the pose in a step in the world frame. Its noise of an observation is the only covariance (2, 2) that the function
reads, R for example, or else `Cx[0:2, 0:2]`.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.user_code import Noise, UserCodeError
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import rotation

EXERCISE = ("Q", "Py")
POSE = "Cx"
CLOSE = 1e-3  # largest relative difference of equal settings


class PoseNoise(np.ndarray):
    """Cx (3, 3) of a file in which `Cx[0:2, 0:2]` is the noise of an observation: these slices return it."""

    __array_priority__ = -1.0  # pyright: ignore[reportIncompatibleMethodOverride, reportAssignmentType]
    of_observation: Float | None = None

    def __getitem__(self, key: Any) -> Any:
        """Return the noise of an observation for `[0:2, 0:2]` and `[:2, :2]`; other elements as usual."""
        slices = key if isinstance(key, tuple) and self.of_observation is not None else ()
        is_corner = [isinstance(each, slice) and each.indices(3) == (0, 2, 1) for each in slices] == [True, True]
        return self.of_observation if is_corner else np.asarray(self)[key]

    def __array_wrap__(self, array: Any, *_: Any) -> Any:
        """Return results of calculations as usual arrays."""
        return np.asarray(array)[()]


class StepNoise:
    """Noise of a step function, and the noise of the recording that replaces it.

    Args:
        space: globals of the function, which `set` changes.
        read: global names that the function reads.
        settings: copies of the settings of the file, by name.
        used: names of all globals and parameters.
        recording: the recording of the run.
        requested: assumed noise: that of the recording, or that of the file.
    """

    def __init__(
        self,
        space: dict[str, Any],
        read: set[str],
        settings: dict[str, Any],
        used: Collection[str],
        recording: Recording,
        requested: Noise,
    ) -> None:
        self._space, self._recording = space, recording
        self._found = _covariances(space, read)
        self._own = {**settings, **self._found}
        self.motion, self.observation = EXERCISE
        if self.observation not in used and np.shape(self._found.get(POSE, 0)) == (3, 3):
            others = [name for name, value in self._found.items() if value.shape == (2, 2)]
            self.motion, self.observation = POSE, others[0] if len(others) == 1 else POSE
        self._used = {self.motion, self.observation} & {*used}
        is_other = self.motion != POSE and np.shape(self._own.get(self.motion, 0)) == (3, 3)
        self.replaced = set[str]() if requested == "file" else self._used - ({self.motion} if is_other else set())

    def set(self, step: int, scan: Observations, dt: float, heading: float) -> None:
        """Set the globals for a step of dt [s] that begins at a heading [rad]; step 0 has no motion."""
        motion, observation = self._motion_cov(step, dt, heading), self._observation_cov(step, scan)
        if motion is not None and self.motion == self.observation:
            motion = motion.view(PoseNoise)
            motion.of_observation = observation
        elif observation is not None:
            self._space[self.observation] = observation
        if motion is not None:
            self._space[self.motion] = motion

    def remarks(self, dt: float) -> list[str]:
        """Return a sentence for each covariance of the file that differs from that of the recording."""
        found: list[str] = []
        if self._recording.steps and self.motion in self._own:
            cov = self._recording.odometry_cov[0]
            given = cov if self.motion == POSE else _input_cov(cov, dt)
            found.append(self._remark(self.motion, self._own[self.motion], given))
        if len(self._recording.observation_cov) and self.observation in self._own:
            own, is_corner = self._own[self.observation], self.observation == self.motion
            name = f"{POSE}[0:2, 0:2]" if is_corner else self.observation
            found.append(self._remark(name, own[:2, :2] if is_corner else own, self._recording.observation_cov[0]))
        return [each for each in (*found, self._lacking()) if each]

    def _motion_cov(self, step: int, dt: float, heading: float) -> Float | None:
        shape = (3, 3) if self.motion == POSE else (2, 2)
        if self.motion not in self.replaced:
            own = _numbers(self._own.get(self.motion, 0))
            return own * (step > 0) if own.shape == shape else None
        if not step:
            return np.zeros(shape)
        cov: Float = self._recording.odometry_cov[step - 1]
        if self.motion != POSE:
            return _input_cov(cov, dt)
        turn = np.eye(3)
        turn[:2, :2] = rotation(heading)
        return turn @ cov @ turn.T

    def _observation_cov(self, step: int, scan: Observations) -> Float | None:
        """Return the covariance of an observation; a bearing-only recording keeps the file's variance of ranges."""
        corner = self._own[POSE][:2, :2] if self.observation == POSE else None
        if self.observation not in self.replaced or not len(scan.value):
            return corner
        if not (scan.cov == scan.cov[0]).all():
            what = f"step {step}: observations of one scan have different noise"
            raise UserCodeError(f"{what}, which one {self.observation} cannot express; take its own, --noise file")
        given: Float = scan.cov[0]
        cov = _numbers(self._own.get(self.observation, given) if corner is None else corner)
        if cov.ndim != 2 or len({*cov.shape}) != 1 or len(cov) < len(given):
            what = f"its {self.observation} must be a square matrix of at least {len(given)} rows"
            raise UserCodeError(f"{what}, for the noise of an observation; mend it, or take its own, --noise file")
        cov[-len(given) :, -len(given) :] = given
        return cov

    def _remark(self, name: str, own: object, given: Float) -> str:
        """Compare a covariance of the file with that of the recording."""
        values = _numbers(own)
        if values.shape[:1] == (2,) and values.ndim == 2 and len(given) == 1:
            values = values[-1:, -1:]
        if values.shape == given.shape and np.allclose(values, given, rtol=CLOSE, atol=0.0):
            return ""
        is_root = values.shape == given.shape and np.allclose(values, np.sqrt(abs(given)), rtol=CLOSE, atol=0.0)
        frame = " (body frame)" if name == POSE else ""
        hint = ": it has standard deviations, a square is missing" if is_root else ""
        if name.partition("[")[0] in self.replaced:
            return f"{name} of the file, {shown(own)}, is replaced by the recording's, {shown(given)}{frame}{hint}"
        return f"assumes {name} of the file, {shown(own)}, where the recording has {shown(given)}{frame}{hint}"

    def _lacking(self) -> str:
        """Return a sentence on noise that the file has under other names."""
        missing = [name for name in (self.motion, self.observation) if name not in self._used]
        if not missing:
            return ""
        others = [f"{name} = {shown(value)}" for name, value in self._found.items() if name not in EXERCISE]
        values = ", ".join(each for each in others if "sim" not in each.partition(" ")[0])
        return f"noise of its own{f', {values}' if values else ''}: the file has no {' and no '.join(missing)}"


def _input_cov(cov: Float, dt: float) -> Float:
    """Return the covariance (2, 2) of speed [m/s] and yaw rate [rad/s], given that of an increment."""
    return cov[np.ix_([0, 2], [0, 2])] / dt**2


def _covariances(space: dict[str, Any], names: set[str]) -> dict[str, Float]:
    """Return the square matrices of 1 to 3 rows among global names."""
    found: dict[str, Float] = {}
    for name in sorted(names & {*space}):
        value = space[name]
        if isinstance(value, np.ndarray) and value.ndim == 2 and len(value) in (1, 2, 3) and len({*value.shape}) == 1:
            found[name] = value.copy()
    return found


def _numbers(value: object) -> Float:
    """Return a copy of a matrix; an empty array for anything else."""
    try:
        return np.array(value, float)
    except (TypeError, ValueError):
        return np.zeros(0)


def shown(value: object) -> str:
    """Return a matrix in few characters, `diag(0.09, 0.0027)` if it is diagonal."""
    array = _numbers(value)
    if not array.size:
        return repr(value)[:40]
    if array.ndim == 2 and len({*array.shape}) == 1 and not (array - np.diag(np.diag(array))).any():
        return f"diag({', '.join(f'{each:.3g}' for each in np.diag(array))})"
    return np.array2string(array, precision=3, separator=", ").replace("\n", "")
