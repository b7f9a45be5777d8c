"""Online classes under their usual names: they contain the state and its covariance as attributes.

    predict, prediction, motion_update, prediction_step       with (v, w, dt), (u), (u, dt), (increment, cov), ...
    update, correct, correction, measurement_update, ...       with (ids, z), (z, id), (id, r, b), (z), ...
    mu, x, xEst, state, mean                                  (3+2n,) or (3+2n, 1): robot, then landmarks
    Sigma, sigma, P, PEst, cov, covariance                    (3+2n, 3+2n)

Constructor parameters are filled by name (`construction.ROLES`). What names leave open is tried on a tiny recording
with a known answer (`tiny_recording`): the way is kept whose poses, covariances and landmarks come out right.

Conventions. A 2 x 2 noise of the motion is that of the control: speed and yaw rate, or distance and turn. A 3 x 3 noise
is that of the increment in the body frame. Landmarks are numbered 0, 1, ... (or 1, 2, ...) in the order of first
observation, so number j is at state[3+2j : 5+2j], whether the state grows or has room for all from the start; variances
of landmarks that have not been observed are at most 1000 m^2. The start
pose and the noise of the recording replace attributes of the usual names if the constructor does not take them.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.class_calls import Way, predict_calls, update_calls
from slamgauge.compare.estimators.forms.construction import LETTERS, Noise, constructed, roles_of
from slamgauge.compare.estimators.forms.signatures import required
from slamgauge.compare.estimators.forms.state_log import StateLog
from slamgauge.compare.estimators.forms.tiny_recording import best_of, tiny_recording
from slamgauge.compare.estimators.fresh_modules import Code, Fresh
from slamgauge.compare.estimators.user_code import UserCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.sensors import SENSORS

PREDICT = ("predict", "prediction", "motion_update", "prediction_step", "predict_step")
UPDATE = ("update", "correct", "correction", "measurement_update", "correction_step", "update_step")
STATES = ("mu", "x", "xEst", "state", "mean", "X", "mu_t", "state_mean", "x_est")
COVS = ("Sigma", "sigma", "P", "PEst", "cov", "covariance", "state_cov", "P_est", "Sigma_t")
KNOWN = {"mean", "cov", "motion", "measurement", "count", "dt", "sensor", "x", "y", "theta"}
UNSEEN = 1000.0  # largest variance [m^2] of landmarks that have not been observed; with more, rounding grows
ROBOT = 3


def methods_of(kind: object) -> tuple[str, str] | None:
    """Return the names of both methods of a class; None if it lacks one."""
    found = [next((n for n in names if callable(getattr(kind, n, None))), "") for names in (PREDICT, UPDATE)]
    return (found[0], found[1]) if all(found) else None


def description(given: Fresh) -> str | None:
    """Describe an online class with the usual attributes; return None for anything else."""
    kind = given.callee
    methods = methods_of(kind) if inspect.isclass(kind) else None
    if methods is None:
        return None
    used = _attribute_names(kind)
    state, cov = (next((n for n in names if n in used), None) for names in (STATES, COVS))
    if state is None or cov is None or "pose_cov" in used:
        return None
    calls = (f"{name}({', '.join(required(getattr(kind, name))[1:])})" for name in methods)
    return f"online class {getattr(kind, '__name__', '')}: {', '.join(calls)}, state {state}, {cov}"


def _attribute_names(kind: Any) -> set[str]:
    """Return the attributes that a class has, or that its methods read or set."""
    functions = (f for base in kind.__mro__ for f in vars(base).values() if inspect.isfunction(f))
    return {*dir(kind), *getattr(kind, "__annotations__", ()), *(n for f in functions for n in f.__code__.co_names)}


@dataclass
class UsualClass:
    """An online class as an estimator; `code` loads the class again for each run."""

    code: Code
    _ways: dict[bool, Way] = field(default_factory=dict, init=False)
    _replaced: dict[str, Float] = field(default_factory=dict, init=False)

    def __call__(self, recording: Recording) -> Estimate:
        """Run a new object over a recording.

        Raises:
            UserCodeError: the recording lacks ranges or bearings, the constructor needs something unknown, or no way to
                call the class gives a state.
        """
        if not SENSORS[recording.sensor].has_range or not SENSORS[recording.sensor].has_bearing:
            raise UserCodeError("this class takes ranges and bearings; give a recording that has them")
        has_ids = recording.landmark is not None
        if has_ids not in self._ways:
            with self.code.fresh() as fresh:
                self._ways[has_ids] = way_of(fresh.callee, has_ids, _step_of(recording, 1))
        with self.code.fresh() as fresh:
            run = Run(fresh.callee, recording, self._ways[has_ids])
            self._replaced = run.noise.replaced
            return run.estimate()

    def remarks(self, recording: Recording) -> list[str]:
        """Return how the class is called, and which of its own settings the recording replaces."""
        way = self._ways.get(recording.landmark is not None)
        if way is None or way.update is None:
            return []
        said = [f"called as {way.predict.words}, {way.update.words}{', ids from 1' if way.first_id else ''}"]
        if self._replaced:
            said.append(f"its own {', '.join(self._replaced)} replaced by the noise of the recording")
        return said


class Run:
    """An object of the class on a recording.

    Raises:
        UserCodeError: the class cannot be constructed, or has no state.
    """

    def __init__(self, kind: Any, recording: Recording, way: Way) -> None:
        self._recording, self._way = recording, way
        ids = [] if recording.landmark is None else [*dict.fromkeys(recording.landmark.tolist())]
        self._number = {name: j for j, name in enumerate(ids)}
        self._seen = 0
        roles = roles_of(kind, KNOWN)
        if recording.landmark is None:
            if any(roles.get(name) == "count" for name in required(kind)):
                raise UserCodeError("its constructor needs the number of landmarks; give a recording with ids")
            roles = {name: role for name, role in roles.items() if role != "count"}
        values = self._values(recording, len(ids))
        self.slam = constructed(kind, roles, values)
        passed = {role: values[role] for role in ("motion", "measurement") if role in roles.values()}
        size = way.motion_size
        self.noise = Noise(self.slam, passed, {"motion": (size, size), "measurement": (2, 2)})
        self._state_name, self._cov_name = self._names()
        self._start(roles, len(ids))
        self._methods = methods_of(kind) or ("predict", "update")

    def _values(self, recording: Recording, count: int) -> dict[str, Any]:
        motion, measurement = self._motion_cov(1), _first_cov(recording)
        if self._way.is_swapped:
            motion, measurement = measurement, motion
        mean, cov = recording.prior_mean, recording.prior_cov
        if "full" in self._way.state_shape:
            mean = np.concatenate([mean, np.zeros(2 * count)])
            full = np.diag(np.full(len(mean), UNSEEN))
            full[:ROBOT, :ROBOT] = cov
            cov = full
        if "column" in self._way.state_shape:
            mean = mean.reshape(-1, 1)
        x, y, theta = recording.prior_mean.tolist()
        plain = {"count": count, "dt": _step_of(recording, 1), "sensor": recording.sensor, "x": x, "y": y}
        return {"mean": mean, "cov": cov, "motion": motion, "measurement": measurement, "theta": theta, **plain}

    def _motion_cov(self, step: int) -> Float:
        """Return the noise of the motion of a step, in the size and unit of the class."""
        if not self._recording.steps:
            return np.zeros((self._way.motion_size, self._way.motion_size))
        cov = self._recording.odometry_cov[step - 1]
        if self._way.motion_size == ROBOT:
            return cov.copy()
        is_speed = self._way.predict.unit == "speed"
        return cov[np.ix_([0, 2], [0, 2])] / (_step_of(self._recording, step) ** 2 if is_speed else 1.0)

    def _names(self) -> tuple[str, str]:
        """Return the names of the attributes with state and covariance."""
        for state, cov in product(STATES, COVS):
            x, P = (_real(getattr(self.slam, name, None)) for name in (state, cov))
            if x.size >= ROBOT and x.size % 2 and P.shape == (x.size, x.size):
                return state, cov
        given = ", ".join(f"{n} {np.shape(getattr(self.slam, n))}" for n in (*STATES, *COVS) if hasattr(self.slam, n))
        what = f"its attributes are no state (3+2n,) and covariance (3+2n, 3+2n): {given}"
        raise UserCodeError(f"{what}; call them mu and Sigma, or x and P")

    def _start(self, roles: dict[str, str], count: int) -> None:
        """Set start pose and covariance where the constructor does not take them; bound variances of landmarks."""
        x, P = _real(getattr(self.slam, self._state_name)), _real(getattr(self.slam, self._cov_name))
        self._has_room = x.size > ROBOT and x.size >= ROBOT + 2 * count
        if "mean" not in roles.values():
            x.reshape(-1)[:ROBOT] = self._recording.prior_mean
            setattr(self.slam, self._state_name, x)
        unseen = np.arange(ROBOT, len(P))
        P[unseen, unseen] = np.minimum(P[unseen, unseen], UNSEEN)
        if "cov" not in roles.values():
            P[:ROBOT, :ROBOT] = self._recording.prior_cov
        setattr(self.slam, self._cov_name, P)

    def estimate(self) -> Estimate:
        """Run over the recording; return the estimate."""
        log = StateLog(self._recording, (self._state_name, self._cov_name))
        is_named = self._way.update is None or self._way.update.has_ids
        for step, scan in enumerate(self._recording.scans()):
            log.step(step, scan.landmark if is_named else None, lambda step=step, scan=scan: self._advanced(step, scan))
        return log.estimate()

    def _advanced(self, step: int, scan: Observations) -> tuple[Any, Any]:
        roles = ("measurement", "motion") if self._way.is_swapped else ("motion", "measurement")
        predict, update = (getattr(self.slam, name) for name in self._methods)
        if step > 0:
            self.noise.set(roles[0], cov := self._motion_cov(step))
            self._way.predict.run(predict, (self._recording.odometry[step - 1], cov, _step_of(self._recording, step)))
        if len(scan.value) and self._way.update is not None:
            self.noise.set(roles[1], scan.cov[0])
            self._way.update.run(update, self._numbered(scan))
        x, P = _real(getattr(self.slam, self._state_name)), _real(getattr(self.slam, self._cov_name))
        size = ROBOT + 2 * self._seen if self._has_room else x.size
        return x.reshape(-1)[:size], P[:size, :size]

    def _numbered(self, scan: Observations) -> Observations:
        """Return the scan with numbers in the order of first observation instead of ids."""
        if scan.landmark is None:
            return scan
        numbers = np.array([self._number[name] for name in scan.landmark.tolist()], dtype=np.int64)
        self._seen = max(self._seen, int(numbers.max()) + 1)
        return scan._replace(landmark=numbers + self._way.first_id)


def _first_cov(recording: Recording) -> Float:
    return recording.observation_cov[0] if len(recording.observation_cov) else np.eye(2)


def _step_of(recording: Recording, step: int) -> float:
    """Return the length of a step [s]."""
    return float(recording.stamps[step] - recording.stamps[step - 1]) if recording.steps else 1.0


def _real(value: object) -> Float:
    """Return a copy as an array of numbers; an empty one for anything else."""
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        return np.zeros(0)


def way_of(kind: Any, has_ids: bool, step_s: float) -> Way:
    """Return the way to construct and call a class whose results on a tiny recording are right, or nearly so.

    Args:
        kind: the class.
        has_ids: whether the recording has ids.
        step_s: time between poses [s].

    Raises:
        UserCodeError: a parameter has no known name.
        Exception: error of the class if each way raises one.
    """
    tiny = tiny_recording(step_s)
    recording = tiny if has_ids else replace(tiny, landmark=None)
    predict, update = (getattr(kind, name) for name in methods_of(kind) or ("predict", "update"))
    roles = roles_of(kind, KNOWN)
    swaps = (False, True) if {*roles} >= LETTERS else (False,)
    shapes = ("flat", "column", "full", "full column") if "mean" in roles.values() else ("flat", "full")
    starts = product(predict_calls(predict), (2, 3), swaps, shapes)
    way = best_of(
        [Way(call, size, swap, shape) for call, size, swap, shape in starts],
        lambda way: Run(kind, recording, way).estimate(),
        recording,
        is_blind=True,
    )
    calls = update_calls(update, has_ids=has_ids)
    return best_of(
        [way._replace(update=call, first_id=first_id) for first_id in (0, 1) for call in calls],
        lambda way: Run(kind, recording, way).estimate(),
        recording,
        is_blind=False,
    )
