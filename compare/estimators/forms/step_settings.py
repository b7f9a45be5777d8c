"""Settings of a step function: globals or parameters DT, Q, Py, KNOWN_DATA_ASSOCIATION and M_DIST_TH.

The recording's values replace those of the file. Every replaced value is named in the remarks of the run. These are
kept:

* KNOWN_DATA_ASSOCIATION = 0: the function gets no ids and associates on its own;
* M_DIST_TH, which is 9.0 for a function that takes it as a parameter and has no value for it;
* Q and Py if the noise of the file is requested;
* noise under other names, for example Cx, or Q (3, 3) of the pose: it cannot be set to that of a recording.
"""

from __future__ import annotations

import inspect
from copy import deepcopy
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.inputs import (
    CLOSE,
    control_cov,
    noise_remark,
    observation_cov,
    shown,
    step_length,
)
from slamgauge.compare.estimators.forms.signatures import parameters
from slamgauge.compare.estimators.forms.step_source import covariances_in, names_read
from slamgauge.compare.estimators.user_code import Callee, Noise, UserCodeError
from slamgauge.recording import Observations, Recording

STATE_AND_INPUT = 4  # parameters that every variant has
NOISES = ("Q", "Py")
KNOWN = "KNOWN_DATA_ASSOCIATION"
DISTANCE, USUAL_DISTANCE = "M_DIST_TH", 9.0  # squared Mahalanobis distance; value of the exercise
SETTINGS = ("DT", *NOISES, KNOWN, DISTANCE)
IDS = "trueLandmarkId"  # list of ids, empty at the start, in files of the exercise


class StepSettings:
    """Settings of a step function and the recording that replaces them.

    Args:
        function: the step function, as new.
        recording: the recording of the run.
        noise: assumed noise: that of the recording, or Q and Py of the file.

    Raises:
        UserCodeError: the function does not use DT, or a setting has no value.
    """

    def __init__(self, function: Callee, recording: Recording, noise: Noise) -> None:
        self.space: dict[str, Any] = getattr(function, "__globals__", {})
        self._recording = recording
        self._parameters = {each.name: each for each in parameters(function)[STATE_AND_INPUT:]}
        self._read = names_read(function)
        self._file = self._values_of_the_file()
        self._set = self._names_to_set(noise)
        has_ids = recording.landmark is not None
        self._reads_known = KNOWN in {*self._read, *self._parameters}
        is_known = self._file.get(KNOWN, True) if self._reads_known else DISTANCE not in self._read
        self.shows_ids = has_ids and bool(is_known)
        if DISTANCE in self._parameters and DISTANCE not in self._file:
            self.space[DISTANCE] = USUAL_DISTANCE
        if IDS in self._read:
            self.space.setdefault(IDS, [])
        self._require_values()

    @property
    def observation_cov(self) -> Any:
        """Covariance of an observation in the file; None if it has none."""
        return self._file.get("Py")

    @property
    def replaces_noise(self) -> bool:
        """Whether Q or Py of the recording replaces another one of the file."""
        return any(self._noise_remark(name) for name in self._set if name in self._file)

    @property
    def uses_matrices(self) -> bool:
        """Whether the function uses `numpy.matrix`, for which `*` is the product of matrices."""
        return "matrix" in self._read

    def named(self) -> dict[str, Any]:
        """Return arguments for parameters of these names."""
        return {name: self.space[name] for name in self._parameters if name in SETTINGS and name in self.space}

    def set(self, step: int, scan: Observations) -> None:
        """Set the globals of a step; a scan at step 0 comes before any motion, so that Q is zero there."""
        self.space["DT"] = step_length(self._recording, step)
        if KNOWN in {*self.space, *self._parameters}:
            self.space[KNOWN] = int(self.shows_ids)
        if "Py" in self._set and len(scan.value):
            self.space["Py"] = self._checked_observation_cov(step, scan)
        if "Q" in self._set:
            self.space["Q"] = control_cov(self._recording, step) * (step > 0)
        elif np.shape(self._file.get("Q", 0)) == (2, 2):
            self.space["Q"] = np.array(self._file["Q"]) * (step > 0)

    def remarks(self) -> list[str]:
        """Return a sentence for each setting of the file that is replaced, or kept against the recording."""
        return [each for each in (self._dt_remark(), self._association_remark(), *self._noise_remarks()) if each]

    def _values_of_the_file(self) -> dict[str, Any]:
        """Return copies of the settings that the file has, as globals or defaults of parameters."""
        defaults = {name: each.default for name, each in self._parameters.items() if each.default is not each.empty}
        found = {name: {**defaults, **self.space}[name] for name in SETTINGS if name in {**defaults, **self.space}}
        return deepcopy(found)

    def _names_to_set(self, noise: Noise) -> tuple[str, ...]:
        """Return which of Q and Py are set to the noise of the recording."""
        if noise == "file":
            return ()
        used = {*self.space, *self._parameters}
        is_of_the_pose = np.shape(self._file.get("Q", 0)) == (3, 3)
        return tuple(name for name in NOISES if name in used and not (name == "Q" and is_of_the_pose))

    def _require_values(self) -> None:
        if "DT" not in {*self.space, *self._parameters}:
            raise UserCodeError("has no global DT; let it read them")
        known = {"DT", KNOWN, *self._set, *self.space}
        for name, each in self._parameters.items():
            if name in SETTINGS and name not in known and each.default is each.empty:
                raise UserCodeError(f"no global has the value of its parameter {name}; give it a default")

    def _checked_observation_cov(self, step: int, scan: Observations) -> Float:
        """Return the covariance of an observation; a bearing-only recording keeps the file's variance of ranges."""
        if not (scan.cov == scan.cov[0]).all():
            what = f"step {step}: observations of one scan have different noise, which one Py cannot express"
            raise UserCodeError(f"{what}; take its own, --noise file")
        given: Float = scan.cov[0]
        try:
            Py = np.array(self._file.get("Py", given), float)
        except (TypeError, ValueError):
            Py = np.zeros(0)
        if Py.ndim != 2 or len({*Py.shape}) != 1 or len(Py) < len(given):
            what = f"its Py must be a square matrix of at least {len(given)} rows, for the noise of an observation"
            raise UserCodeError(f"{what}; mend it, or take its own, --noise file")
        Py[-len(given) :, -len(given) :] = given
        return Py

    def _dt_remark(self) -> str:
        own, given = self._file.get("DT"), step_length(self._recording, 1)
        if not isinstance(own, int | float) or abs(own - given) <= CLOSE * given:
            return ""
        return f"DT of the file, {own:g} s, is replaced by the recording's, {given:.4g} s"

    def _association_remark(self) -> str:
        if self._recording.landmark is None:
            what = f"{KNOWN} of the file, {self._file.get(KNOWN)}, is replaced by 0: the recording has no ids"
            return what if self._file.get(KNOWN) and self._reads_known else ""
        if self.shows_ids:
            return ""
        why = f"{KNOWN} is 0" if self._reads_known else f"it uses {DISTANCE} and not {KNOWN}"
        return f"associates on its own and gets no ids, since {why} in the file; its map has no ids and is not graded"

    def _noise_remarks(self) -> list[str]:
        found = [self._noise_remark(name) for name in NOISES if name in self._file]
        others = {name: value for name, value in covariances_in(self.space, self._read).items() if name not in NOISES}
        if len({*NOISES} & {*self.space, *self._parameters}) < len(NOISES):
            values = ", ".join(f"{name} = {shown(value)}" for name, value in others.items() if "sim" not in name)
            lacking = " and no ".join(name for name in NOISES if name not in {*self.space, *self._parameters})
            found.append(f"noise of its own{f', {values}' if values else ''}: the file has no {lacking}")
        return found

    def _noise_remark(self, name: str) -> str:
        """Compare a covariance of the file with that of the recording."""
        if not (self._recording.steps if name == "Q" else len(self._recording.observation_cov)):
            return ""
        given = control_cov(self._recording, 1) if name == "Q" else observation_cov(self._recording)
        return noise_remark(name, self._file[name], given, is_replaced=name in self._set)


def is_setting(parameter: inspect.Parameter, space: dict[str, Any]) -> bool:
    """Return whether a parameter after y has a global of its name that is no list, dict or set.

    Lists, dicts and sets are values that the function passes on from step to step.
    """
    return parameter.name in space and not isinstance(space[parameter.name], list | dict | set)
