"""Settings of a step function: DT, KNOWN_DATA_ASSOCIATION, M_DIST_TH and its noise, globals or parameters.

The recording's values replace those of the file. Every replaced value is named in the remarks of the run. These are
kept:

* KNOWN_DATA_ASSOCIATION = 0: the function gets no ids and associates on its own;
* M_DIST_TH, which is 9.0 for a function that takes it as a parameter and has no value for it. In a file with Cx it fits
  the noise of the file only: 13.8 replaces it where the recording's noise replaces that of the file;
* the noise of the file if it is requested;
* noise under other names than those of `step_noise`: it cannot be set to that of a recording.
"""

from __future__ import annotations

import inspect
from copy import deepcopy
from typing import Any

from slamgauge.compare.estimators.forms.inputs import CLOSE, step_length
from slamgauge.compare.estimators.forms.signatures import parameters
from slamgauge.compare.estimators.forms.step_noise import EXERCISE, POSE, StepNoise
from slamgauge.compare.estimators.forms.step_source import names_read
from slamgauge.compare.estimators.user_code import Callee, Noise, UserCodeError
from slamgauge.ekf.settings import PLAIN
from slamgauge.recording import Observations, Recording

STATE_AND_INPUT = 4  # parameters that every variant has
KNOWN = "KNOWN_DATA_ASSOCIATION"
DISTANCE, USUAL_DISTANCE = "M_DIST_TH", 9.0  # squared Mahalanobis distance; value of the exercise
WIDE_DISTANCE = PLAIN.gate  # one correct observation in a thousand has a larger distance
SETTINGS = ("DT", *EXERCISE, KNOWN, DISTANCE)
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
        self._used = {*self.space, *self._parameters}
        self._noise = StepNoise(self.space, self._read, self._file, self._used, recording, noise)
        has_ids = recording.landmark is not None
        self._reads_known = KNOWN in {*self._read, *self._parameters}
        is_known = self._file.get(KNOWN, True) if self._reads_known else DISTANCE not in self._read
        self.shows_ids = has_ids and bool(is_known)
        if DISTANCE in self._parameters and DISTANCE not in self._file:
            self.space[DISTANCE] = USUAL_DISTANCE
        if self._replaces_distance:
            self.space[DISTANCE] = WIDE_DISTANCE
        if IDS in self._read:
            self.space.setdefault(IDS, [])
        self._require_values()

    @property
    def observation_cov(self) -> Any:
        """Covariance of an observation in the file; None if it has none."""
        return self._file.get("Py")

    @property
    def replaces_noise(self) -> bool:
        """Whether the noise of the recording replaces another one of the file."""
        return self._noise.replaces_noise

    @property
    def uses_matrices(self) -> bool:
        """Whether the function uses `numpy.matrix`, for which `*` is the product of matrices."""
        return "matrix" in self._read

    def named(self) -> dict[str, Any]:
        """Return arguments for parameters of these names."""
        return {name: self.space[name] for name in self._parameters if name in SETTINGS and name in self.space}

    def set(self, step: int, scan: Observations, heading: float) -> None:
        """Set the globals of a step that begins at a heading [rad]."""
        self.space["DT"] = step_length(self._recording, step)
        if KNOWN in self._used:
            self.space[KNOWN] = int(self.shows_ids)
        self._noise.set(step, scan, heading)

    def remarks(self) -> list[str]:
        """Return a sentence for each setting of the file that is replaced, or kept against the recording."""
        found = [self._dt_remark(), self._association_remark(), *self._noise.remarks()]
        if self._replaces_distance:
            why = f"that of the file fits its {POSE}, which is replaced"
            found.append(f"{DISTANCE} of the file, {self._file[DISTANCE]}, is replaced by {WIDE_DISTANCE}: {why}")
        return [each for each in found if each]

    @property
    def _replaces_distance(self) -> bool:
        return POSE in self._noise.replaced and DISTANCE in self._file

    def _values_of_the_file(self) -> dict[str, Any]:
        """Return copies of the settings that the file has, as globals or defaults of parameters."""
        defaults = {name: each.default for name, each in self._parameters.items() if each.default is not each.empty}
        found = {name: {**defaults, **self.space}[name] for name in SETTINGS if name in {**defaults, **self.space}}
        return deepcopy(found)

    def _require_values(self) -> None:
        if "DT" not in self._used:
            raise UserCodeError("has neither a global nor a parameter DT, the length of a step [s]; use that name")
        known = {"DT", KNOWN, *self._noise.replaced, *self.space}
        for name, each in self._parameters.items():
            if name in SETTINGS and name not in known and each.default is each.empty:
                raise UserCodeError(f"no global has the value of its parameter {name}; give it a default")

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


def is_setting(parameter: inspect.Parameter, space: dict[str, Any]) -> bool:
    """Return whether a parameter after y has a global of its name that is no list, dict or set.

    Lists, dicts and sets are values that the function passes on from step to step.
    """
    return parameter.name in space and not isinstance(space[parameter.name], list | dict | set)
