"""Noise of a step function: two covariances, globals or parameters of its file.

The exercise has Q (2, 2), noise of u, and Py (2, 2), noise of an observation. PythonRobotics has Cx (3, 3), noise of
the pose in a step in the world frame. Its noise of an observation is the only covariance (2, 2) that the function
reads, R for example, or else `Cx[0:2, 0:2]`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.inputs import (
    control_cov,
    increment_cov,
    noise_remark,
    numbers,
    observation_cov,
    shown,
    world_cov,
)
from slamgauge.compare.estimators.user_code import Noise, UserCodeError
from slamgauge.recording import Observations, Recording

EXERCISE = ("Q", "Py")
POSE = "Cx"


class PoseNoise(np.ndarray):
    """Cx (3, 3) of a file in which `Cx[0:2, 0:2]` is the noise of an observation: these slices return it."""

    __array_priority__ = -1.0
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
        read: Collection[str],
        settings: dict[str, Any],
        used: Collection[str],
        recording: Recording,
        requested: Noise,
    ) -> None:
        self._space, self._recording = space, recording
        self._found = _covariances(space, {*read})
        self._own = {**settings, **self._found}
        self.motion, self.observation = EXERCISE
        if self.observation not in used and np.shape(self._found.get(POSE, 0)) == (3, 3):
            others = [name for name, value in self._found.items() if value.shape == (2, 2)]
            self.motion, self.observation = POSE, others[0] if len(others) == 1 else POSE
        self._used = {self.motion, self.observation} & {*used}
        is_other = self.motion != POSE and np.shape(self._own.get(self.motion, 0)) == (3, 3)
        self.replaced = frozenset[str]() if requested == "file" else self._used - ({self.motion} if is_other else set())

    def set(self, step: int, scan: Observations, heading: float) -> None:
        """Set the globals for a step that begins at a heading [rad]; step 0 has no motion."""
        motion, observation = self._motion_cov(step, heading), self._observation_cov(step, scan)
        if motion is not None and self.motion == self.observation:
            motion = motion.view(PoseNoise)
            motion.of_observation = observation
        elif observation is not None:
            self._space[self.observation] = observation
        if motion is not None:
            self._space[self.motion] = motion

    @property
    def replaces_noise(self) -> bool:
        """Whether the noise of the recording replaces another one of the file."""
        return any(remark and name in self.replaced for name, remark in self._compared())

    def remarks(self) -> list[str]:
        """Return a sentence for each covariance of the file that differs from that of the recording."""
        return [each for each in (*(remark for _, remark in self._compared()), self._lacking()) if each]

    def _compared(self) -> Iterator[tuple[str, str]]:
        """Yield the names of the covariances of the file, with a sentence, or an empty text if they are equal."""
        if self._recording.steps and self.motion in self._own:
            is_pose = self.motion == POSE
            given = increment_cov(self._recording, 1) if is_pose else control_cov(self._recording, 1)
            remark = self._remark(self.motion, self.motion, self._own[self.motion], given)
            yield self.motion, f"{remark} (body frame)" if is_pose and remark else remark
        if len(self._recording.observation_cov) and self.observation in self._own:
            own, is_corner = self._own[self.observation], self.observation == self.motion
            text = f"{POSE}[0:2, 0:2]" if is_corner else self.observation
            given = observation_cov(self._recording)
            yield self.observation, self._remark(self.observation, text, own[:2, :2] if is_corner else own, given)

    def _remark(self, name: str, text: str, own: object, given: Float) -> str:
        return noise_remark(text, own, given, is_replaced=name in self.replaced)

    def _motion_cov(self, step: int, heading: float) -> Float | None:
        shape = (3, 3) if self.motion == POSE else (2, 2)
        if self.motion not in self.replaced:
            own = numbers(self._own.get(self.motion, 0))
            return own * (step > 0) if own.shape == shape else None
        if not step:
            return np.zeros(shape)
        if self.motion != POSE:
            return control_cov(self._recording, step)
        return world_cov(self._recording, step, heading)

    def _observation_cov(self, step: int, scan: Observations) -> Float | None:
        """Return the covariance of an observation; a bearing-only recording keeps the file's variance of ranges."""
        corner = self._own[POSE][:2, :2] if self.observation == POSE else None
        if self.observation not in self.replaced or not len(scan.value):
            return corner
        if not (scan.cov == scan.cov[0]).all():
            what = f"step {step}: observations of one scan have different noise"
            raise UserCodeError(f"{what}, which one {self.observation} cannot express; take its own, --noise file")
        given: Float = scan.cov[0]
        cov = numbers(self._own.get(self.observation, given) if corner is None else corner)
        if cov.size == 1 and cov > 0:  # None is NaN
            return self._bearing_cov(cov, given)
        if cov.ndim != 2 or len({*cov.shape}) != 1 or len(cov) < len(given):
            what = f"its {self.observation} must be a square matrix of at least {len(given)} rows"
            raise UserCodeError(f"{what}, for the noise of an observation; mend it, or take its own, --noise file")
        cov[-len(given) :, -len(given) :] = given
        return cov

    def _bearing_cov(self, cov: Float, given: Float) -> Float:
        """Return the variance of a bearing in the shape of the file's, () or (1, 1); refuse recordings with ranges."""
        if len(given) > 1:
            what = f"it is a bearing-only file, since its {self.observation} is one variance"
            remedy = "use `study` or `grade` on a bearing-only scenario (q4-ring)"
            other = f"a file that takes ranges needs {self.observation} of {len(given)} rows"
            raise UserCodeError(f"{what}; this recording, as those of `check`, has ranges; {remedy}; {other}")
        return given.reshape(cov.shape).copy()

    def _lacking(self) -> str:
        """Return a sentence on noise that the file has under other names."""
        missing = [name for name in (self.motion, self.observation) if name not in self._used]
        if not missing:
            return ""
        others = [f"{name} = {shown(value)}" for name, value in self._found.items() if name not in EXERCISE]
        values = ", ".join(each for each in others if "sim" not in each.partition(" ")[0])
        return f"noise of its own{f', {values}' if values else ''}: the file has no {' and no '.join(missing)}"


def _covariances(space: dict[str, Any], names: set[str]) -> dict[str, Float]:
    """Return the square matrices of 1 to 3 rows among global names."""
    found: dict[str, Float] = {}
    for name in sorted(names & {*space}):
        value = space[name]
        if isinstance(value, np.ndarray) and value.ndim == 2 and len(value) in (1, 2, 3) and len({*value.shape}) == 1:
            found[name] = value.copy()
    return found
