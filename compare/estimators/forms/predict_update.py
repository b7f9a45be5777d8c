"""Two functions that receive and return the state, and associate by themselves; also NTNU's class of TTK4250.

    predict(eta, P, z_odo) -> eta, P              z_odo (3,) the body-frame increment [m, m, rad]
    update(eta, P, z) -> eta, P, ...              z (m, 2) or (2m,): range [m], bearing [rad], range, bearing, ...
    EKFSLAM(Q, R, do_asso, alphas, sensor_offset) the class with both methods; `update` returns eta, P, NIS, a

eta is (3+2n,). Q (3, 3) is the covariance of the increment in the body frame, R (2, 2) that of an observation:
arguments of the constructor, attributes or globals, set before each call. The code associates, also if the recording
has ids: it does not receive them. `a` (m,) is the number of the landmark of each observation, -1 for a new one; if it
agrees with the ids of the recording at every step, the landmarks of the map have these ids.

`alphas` keeps its default; without one it is (1e-3, 1e-4): probabilities that the joint and the individual gate reject
a right association. Q without sideways noise is singular, and so is P; the checks inside the file often refuse that.
Therefore Q receives a regularising variance of 1e-14 (m^2, rad^2).
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.construction import (
    StoredNoise,
    constructed,
    methods_in,
    roles_of,
    without_defaults,
)
from slamgauge.compare.estimators.forms.inputs import increment_cov, observation_cov, require_ranges_and_bearings
from slamgauge.compare.estimators.forms.probing import best_of, tiny_recording
from slamgauge.compare.estimators.forms.signatures import called, pair, required
from slamgauge.compare.estimators.forms.state_log import StateLog
from slamgauge.compare.estimators.fresh_modules import Code, Fresh
from slamgauge.compare.estimators.user_code import Noise
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording

METHODS = (PREDICT, UPDATE) = ("predict", "update")
STATE_NAMES = {"eta", "x", "mu", "state", "xEst", "mean"}
COV_NAMES = {"P", "Sigma", "sigma", "cov", "PEst", "covariance"}
GATES = (1e-3, 1e-4)
REGULARISING = 1e-14
SHAPES = {"motion": (3, 3), "measurement": (2, 2)}
KNOWN = {*SHAPES, "alphas", "own association", "offset"}


def description(given: Fresh) -> str | None:
    """Describe `predict` or `update` if its module has both; return None otherwise."""
    functions = [given.names.get(name) for name in METHODS]
    predict, update = (required(function) for function in functions)
    if given.callee not in functions or (len(predict), len(update)) != (3, 3):
        return None
    return f"functions {PREDICT} ({', '.join(predict)}) and {UPDATE} ({', '.join(update)})"


def class_description(given: Fresh) -> str | None:
    """Describe a class whose `predict` and `update` receive state and covariance; return None for anything else."""
    kind = given.callee
    if not inspect.isclass(kind):
        return None
    found = [required(getattr(kind, name, None))[1:] for name in METHODS]
    if not all(len(each) == 3 and each[0] in STATE_NAMES and each[1] in COV_NAMES for each in found):
        return None
    calls = (f"{name}({', '.join(each)})" for name, each in zip(METHODS, found, strict=True))
    return f"class of NTNU's course {kind.__name__}: {', '.join(calls)}, associates on its own"


@dataclass
class PredictUpdate:
    """`predict` and `update` as an estimator.

    Attributes:
        code: source of one of the functions, or of the class.
        noise: assumed noise: that of the recording, or that of the file.
        replaces_noise: whether the noise of the recording replaced another one of the file in the last run.
    """

    code: Code
    noise: Noise = "recording"
    _is_flat: bool | None = field(default=None, init=False)
    _remarks: list[str] = field(default_factory=list, init=False)
    replaces_noise: bool = field(default=False, init=False)

    def __call__(self, recording: Recording) -> Estimate:
        """Run the functions, or a new object, over a recording, without its ids.

        Raises:
            UserCodeError: the recording lacks ranges or bearings, the constructor needs something unknown, or no state
                is returned.
        """
        require_ranges_and_bearings(recording)
        if self._is_flat is None:
            tiny = replace(tiny_recording(0.1), landmark=None)
            with self.code.fresh() as fresh:
                self._is_flat = best_of((False, True), lambda is_flat: _Filter(fresh, tiny, is_flat, self.noise), tiny)
        with self.code.fresh() as fresh:
            filter_ = _Filter(fresh, recording, self._is_flat, self.noise)
            given = _first_covs(recording)
            self._remarks, self.replaces_noise = filter_.noise.remarks(given), filter_.noise.is_replaced(given)
            return StateLog(recording).run(filter_)

    def remarks(self, _recording: Recording) -> list[str]:
        """Return which noise of the file is replaced or kept in the last run."""
        return self._remarks


class _Filter:
    """The functions or methods with their state, and the ids of the landmarks that they have mapped."""

    names = ("eta", "P")

    def __init__(self, fresh: Fresh, recording: Recording, is_flat: bool, noise: Noise) -> None:
        self._recording, self._is_flat = recording, is_flat
        self._ids: list[int] = []
        self._associated: object = None
        self._belief: list[Any] = [recording.prior_mean.copy(), recording.prior_cov.copy()]
        passed: dict[str, Float] = {}
        slam: Any = None
        if inspect.isclass(kind := fresh.callee):
            optional = {"alphas", "offset", *(SHAPES if noise == "file" else ())}
            roles = without_defaults(kind, roles_of(kind, KNOWN), optional)
            passed = {role: cov for role, cov in _first_covs(recording).items() if role in roles.values()}
            others = {"alphas": np.array(GATES), "own association": True, "offset": np.zeros(2)}
            slam = constructed(kind, roles, {**passed, **others})
        self._predict, self._update = (fresh.names[name] if slam is None else getattr(slam, name) for name in METHODS)
        methods = (self._predict, self._update) if slam is None else methods_in(type(slam))
        self.noise = StoredNoise(methods, slam, passed, SHAPES, noise)

    def advanced(self, step: int, scan: Observations) -> tuple[Any, Any]:
        """Run a step; return state and covariance."""
        if step > 0:
            self.noise.set("motion", regular(increment_cov(self._recording, step)))
            odometry = self._recording.odometry[step - 1].copy()
            self._belief = pair(called(self._predict, *self._belief, odometry), PREDICT)[:2]
        self._associated = None
        if len(scan.value):
            self.noise.set("measurement", scan.cov[0])
            z = scan.value.reshape(-1).copy() if self._is_flat else scan.value.copy()
            returned = pair(called(self._update, *self._belief, z), UPDATE)
            self._belief, self._associated = returned[:2], returned[3] if len(returned) > 3 else None
        return self._belief[0], self._belief[1]

    def ids(self, scan: Observations) -> Any:
        """Return the ids of a scan if the associations of `update` agree with them, else None."""
        if scan.landmark is None or not len(scan.landmark):
            return scan.landmark
        ids = scan.landmark.tolist()
        right = [self._ids.index(name) if name in self._ids else -1 for name in ids]
        self._ids += [name for name in dict.fromkeys(ids) if name not in self._ids]
        try:
            given = np.asarray(self._associated, np.float64).reshape(-1).tolist()
        except (TypeError, ValueError):
            return None
        return scan.landmark if given == right else None


def _first_covs(recording: Recording) -> dict[str, Float]:
    return {"motion": regular(increment_cov(recording, 1)), "measurement": observation_cov(recording)}


def regular(Q: Float) -> Float:
    """Return Q (3, 3) with a regularising variance if it is singular."""
    return Q + REGULARISING * np.eye(3) if np.linalg.matrix_rank(Q) < len(Q) else Q
