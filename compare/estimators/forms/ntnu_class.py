"""The class of NTNU's course TTK4250: it receives and returns the state, and associates by itself.

    EKFSLAM(Q, R, do_asso, alphas, sensor_offset)
    predict(eta, P, z_odo) -> eta, P              z_odo (3,) the body-frame increment [m, m, rad]
    update(eta, P, z) -> eta, P, NIS, a           z (m, 2) or (2m,): range [m], bearing [rad], range, bearing, ...

Q (3, 3) is the covariance of the increment in the body frame, R (2, 2) that of an observation. Both are set before each
call. The class associates, also if the recording has ids: it does not receive them. `alphas` keeps its default; without
one it is (1e-3, 1e-4): probabilities that the joint and the individual gate reject a right association. `a` (m,) is
the number of the landmark of each observation, -1 for a new one; if it agrees with the ids of the recording at every
step, the landmarks of the map have these ids. Q without sideways noise is singular, and so is P; the checks inside the
file often refuse that. Therefore Q receives a regularising variance of 1e-14 (m^2, rad^2).
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.construction import Noise, constructed, roles_of
from slamgauge.compare.estimators.forms.signatures import called, pair, required
from slamgauge.compare.estimators.forms.state_log import StateLog
from slamgauge.compare.estimators.forms.tiny_recording import LANDMARKS, tiny_recording
from slamgauge.compare.estimators.fresh_modules import Code, Fresh
from slamgauge.compare.estimators.user_code import UserCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.sensors import SENSORS

STATE_NAMES = {"eta", "x", "mu", "state", "xEst", "mean"}
COV_NAMES = {"P", "Sigma", "sigma", "cov", "PEst", "covariance"}
GATES = (1e-3, 1e-4)
REGULARISING = 1e-14
KNOWN = {"motion", "measurement", "alphas", "own association", "offset"}
SHAPES = {"motion": (3, 3), "measurement": (2, 2)}


def description(given: Fresh) -> str | None:
    """Describe a class whose `predict` and `update` receive state and covariance; return None for anything else."""
    kind = given.callee
    if not inspect.isclass(kind):
        return None
    found = [required(getattr(kind, name, None))[1:] for name in ("predict", "update")]
    if not all(len(each) == 3 and each[0] in STATE_NAMES and each[1] in COV_NAMES for each in found):
        return None
    calls = (f"{name}({', '.join(each)})" for name, each in zip(("predict", "update"), found, strict=True))
    return f"class of NTNU's course {kind.__name__}: {', '.join(calls)}, associates by itself"


@dataclass
class NtnuClass:
    """The course's class as an estimator; `code` loads the class again for each run."""

    code: Code
    _is_flat: bool | None = field(default=None, init=False)

    def __call__(self, recording: Recording) -> Estimate:
        """Run a new object over a recording, without its ids.

        Raises:
            UserCodeError: the recording lacks ranges or bearings, the constructor needs something unknown, or a method
                returns no state.
        """
        if not SENSORS[recording.sensor].has_range or not SENSORS[recording.sensor].has_bearing:
            raise UserCodeError("this class takes ranges and bearings; give a recording that has them")
        if self._is_flat is None:
            with self.code.fresh() as fresh:
                self._is_flat = _takes_flat(fresh.callee)
        with self.code.fresh() as fresh:
            return _run(fresh.callee, recording, self._is_flat)


def _takes_flat(kind: Any) -> bool:
    """Return whether `update` takes z as (2m,): run it on a tiny recording both ways."""
    errors: list[Exception] = []
    for is_flat in (False, True):
        try:
            estimate = _run(kind, replace(tiny_recording(0.1), landmark=None), is_flat)
        except UserCodeError:
            raise
        except Exception as error:  # noqa: BLE001 user code raises anything
            errors.append(error)
            continue
        if len(estimate.landmarks) == len(LANDMARKS) and np.abs(estimate.landmarks - LANDMARKS).max() < 0.1:
            return is_flat
    if len(errors) == 2:
        raise errors[0]
    return False


def _run(kind: Any, recording: Recording, is_flat: bool) -> Estimate:
    roles = roles_of(kind, KNOWN)
    Q = recording.odometry_cov[0] if recording.steps else np.zeros((3, 3))
    R = recording.observation_cov[0] if len(recording.observation_cov) else np.eye(2)
    values: dict[str, Any] = {
        "motion": regular(Q),
        "measurement": R,
        "alphas": np.array(GATES),
        "own association": True,
        "offset": np.zeros(2),
    }
    defaults = [name for name, each in inspect.signature(kind).parameters.items() if each.default is not each.empty]
    roles = {n: role for n, role in roles.items() if role not in ("alphas", "offset") or n not in defaults}
    slam = constructed(kind, roles, values)
    filter_ = _Filter(slam, Noise(slam, {r: values[r] for r in SHAPES if r in roles.values()}, SHAPES), is_flat)
    log = StateLog(recording, ("eta", "P"))
    filter_.belief = [recording.prior_mean.copy(), recording.prior_cov.copy()]
    for step, scan in enumerate(recording.scans()):
        odometry = (recording.odometry[step - 1], recording.odometry_cov[step - 1]) if step else None
        log.step(step, partial(filter_.checked_ids, scan), partial(filter_.advanced, odometry, scan))
    return log.estimate()


class _Filter:
    """An object of the class with its state, and the ids of the landmarks that it has mapped."""

    def __init__(self, slam: Any, noise: Noise, is_flat: bool) -> None:
        self._slam, self._noise, self._is_flat = slam, noise, is_flat
        self._ids: list[int] = []
        self._associated: object = None
        self.belief: list[Any] = []

    def advanced(self, odometry: tuple[Float, Float] | None, scan: Observations) -> tuple[Any, Any]:
        """Run a step; return state and covariance."""
        if odometry is not None:
            self._noise.set("motion", regular(odometry[1]))
            self.belief = pair(called(self._slam.predict, *self.belief, odometry[0].copy()), "predict")[:2]
        self._associated = None
        if len(scan.value):
            self._noise.set("measurement", scan.cov[0])
            z = scan.value.reshape(-1).copy() if self._is_flat else scan.value.copy()
            returned = pair(called(self._slam.update, *self.belief, z), "update")
            self.belief, self._associated = returned[:2], returned[3] if len(returned) > 3 else None
        return self.belief[0], self.belief[1]

    def checked_ids(self, scan: Observations) -> Any:
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


def regular(Q: Float) -> Float:
    """Return Q (3, 3) with a regularising variance if it is singular."""
    return Q + REGULARISING * np.eye(3) if np.linalg.matrix_rank(Q) < len(Q) else Q
