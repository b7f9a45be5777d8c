"""Online classes under their usual names: they contain the state and its covariance as attributes.

    predict, prediction, motion_update, prediction_step       with (v, w, dt), (u), (u, dt), (increment, cov), ...
    update, correct, correction, measurement_update, ...       with (ids, z), (z, id), (id, r, b), (z), ...
    mu, x, xEst, state, mean                                  (3+2n,) or (3+2n, 1): robot, then landmarks
    Sigma, sigma, P, PEst, cov, covariance                    (3+2n, 3+2n)

Constructor parameters are filled by name (`construction.ROLES`). What names leave open is tried on a tiny recording
with a known answer (`probing`): the way is kept with the right poses, covariances and landmarks.

Conventions. A 2 x 2 noise of the motion is that of the control: speed and yaw rate, or distance and turn. A 3 x 3 noise
is that of the increment in the body or world frame, whichever fits better. Landmarks are numbered 0, 1, ... (or 1, 2,
...) in the order of first observation, so number j is at state[3+2j : 5+2j], whether the state grows or has room for
all from the start; variances of landmarks that have not been observed are at most 1000 m^2. The start pose and the
noise of the recording replace attributes and globals of the usual names if the constructor does not take them.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.estimators.forms.class_calls import Way, predict_calls, update_calls
from slamgauge.compare.estimators.forms.construction import (
    LETTERS,
    StoredNoise,
    constructed,
    methods_in,
    noise_roles,
    roles_of,
)
from slamgauge.compare.estimators.forms.inputs import (
    block_diagonal,
    control_cov,
    increment_cov,
    numbers,
    observation_cov,
    require_ranges_and_bearings,
    step_length,
    world_cov,
)
from slamgauge.compare.estimators.forms.probing import best_of, follows_arc, tiny_recording
from slamgauge.compare.estimators.forms.signatures import required
from slamgauge.compare.estimators.forms.state_log import StateLog, Steps
from slamgauge.compare.estimators.fresh_modules import Code, Fresh
from slamgauge.compare.estimators.user_code import Noise, UserCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording

PREDICT = ("predict", "prediction", "motion_update", "prediction_step", "predict_step")
UPDATE = ("update", "correct", "correction", "measurement_update", "correction_step", "update_step")
STATES = ("mu", "x", "xEst", "state", "mean", "X", "mu_t", "state_mean", "x_est")
COVS = ("Sigma", "sigma", "P", "PEst", "cov", "covariance", "state_cov", "P_est", "Sigma_t")
KNOWN = {"mean", "cov", "motion", "measurement", "count", "dt", "sensor", "x", "y", "theta"}
UNSEEN = 1000.0  # largest variance [m^2] of landmarks that have not been observed; with more, rounding grows
ROBOT = 3
COVS_OF_NOISE = ("motion", "measurement")  # roles


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
    functions = [f for f in (kind.__init__, *methods_in(kind)) if inspect.isfunction(f)]
    return {*dir(kind), *getattr(kind, "__annotations__", ()), *(n for f in functions for n in f.__code__.co_names)}


@dataclass
class UsualClass:
    """An online class as an estimator.

    Attributes:
        code: loads the class again for each run.
        noise: assumed noise: that of the recording, or that of the file.
        replaces_noise: whether the noise of the recording replaced another one of the file in the last run.
    """

    code: Code
    noise: Noise = "recording"
    _ways: dict[bool, Way] = field(default_factory=dict, init=False)
    _noise_remarks: list[str] = field(default_factory=list, init=False)
    replaces_noise: bool = field(default=False, init=False)

    def __call__(self, recording: Recording) -> Estimate:
        """Run a new object over a recording.

        Raises:
            UserCodeError: the recording lacks ranges or bearings, the constructor needs something unknown, or no way to
                call the class gives a state.
        """
        require_ranges_and_bearings(recording)
        has_ids = recording.landmark is not None
        if has_ids not in self._ways:
            with self.code.fresh() as fresh:
                self._ways[has_ids] = way_of(fresh.callee, has_ids, step_length(recording, 1))
        with self.code.fresh() as fresh:
            run = _Run(fresh.callee, recording, self._ways[has_ids], self.noise)
            self._noise_remarks, self.replaces_noise = run.noise_remarks(), run.replaces_noise()
            return StateLog(recording).run(run)

    def remarks(self, recording: Recording) -> list[str]:
        """Return how the class is called, and which noise of the file is replaced or kept."""
        way = self._ways.get(recording.landmark is not None)
        if way is None or way.update is None:
            return []
        words = f"called as {way.predict.words}, {way.update.words}{', ids from 1' if way.first_id else ''}"
        return [words, *(_arc_remark(recording) if way.is_arc else ()), *self._noise_remarks]


class _Run(Steps):
    """An object of the class on a recording.

    Raises:
        UserCodeError: the class cannot be constructed, or has no state.
    """

    def __init__(self, kind: Any, recording: Recording, way: Way, noise: Noise = "recording") -> None:
        self._recording, self._way = recording, way
        ids = [] if recording.landmark is None else [*dict.fromkeys(recording.landmark.tolist())]
        self._number = {name: j for j, name in enumerate(ids)}
        self._seen, self._heading = 0, recording.prior_mean[2]
        optional = {"count"} if recording.landmark is None else set[str]()
        roles = roles_of(
            kind, KNOWN, optional | {*(COVS_OF_NOISE if noise == "file" else ())}, is_swapped=way.is_swapped
        )
        if recording.landmark is None and "count" in roles.values():
            raise UserCodeError("its constructor needs the number of landmarks; give a recording with ids")
        covs = self._first_covs()
        self._slam = constructed(kind, roles, {**self._values(len(ids)), **covs})
        passed = {role: cov for role, cov in covs.items() if role in roles.values()}
        size = 2 if way.motion == "control" else ROBOT
        shapes = {"motion": (size, size), "measurement": (2, 2)}
        self._noise = StoredNoise(
            methods_in(kind), self._slam, passed, shapes, noise_roles(is_swapped=way.is_swapped), noise
        )
        self.names = self._found_names()
        self._start(roles, len(ids))
        self._predict, self._update = (getattr(self._slam, name) for name in methods_of(kind) or ("predict", "update"))

    def noise_remarks(self) -> list[str]:
        """Return sentences on the noise of the file."""
        return self._noise.remarks(self._first_covs(), self.names)

    def replaces_noise(self) -> bool:
        """Return whether the noise of the recording replaces another one of the file."""
        return self._noise.is_replaced(self._first_covs())

    def advanced(self, step: int, scan: Observations) -> tuple[Any, Any]:
        """Run a step; return state and covariance of the landmarks observed so far."""
        self._heading = numbers(getattr(self._slam, self.names[0])).reshape(-1)[2]
        covs = self._noise_covs(step, scan.cov[0] if len(scan.value) else observation_cov(self._recording))
        for role, cov in covs.items():
            self._noise.set(role, cov)
        if step > 0:
            motion = self._recording.odometry[step - 1], self._motion_cov(step), step_length(self._recording, step)
            self._way.predict.run(self._predict, motion)
        if len(scan.value) and self._way.update is not None:
            self._way.update.run(self._update, self._numbered(scan))
        x, P = (numbers(getattr(self._slam, name)) for name in self.names)
        size = ROBOT + 2 * self._seen if self._has_room else x.size
        return x.reshape(-1)[:size], P[:size, :size]

    def ids(self, scan: Observations) -> Int | None:
        """Return the ids of a scan if the class receives them."""
        return scan.landmark if self._way.update is None or self._way.update.has_ids else None

    def _first_covs(self) -> dict[str, Float]:
        """Return the first covariances of the recording by role."""
        return self._noise_covs(1, observation_cov(self._recording))

    def _values(self, count: int) -> dict[str, Any]:
        """Return the arguments of the constructor by role, without noise."""
        mean, cov = self._recording.prior_mean, self._recording.prior_cov
        if "full" in self._way.state_shape:
            mean = np.concatenate([mean, np.zeros(2 * count)])
            cov = block_diagonal(cov, UNSEEN * np.eye(2 * count))
        if "column" in self._way.state_shape:
            mean = mean.reshape(-1, 1)
        start = dict(zip(("x", "y", "theta"), self._recording.prior_mean.tolist(), strict=True))
        plain = {"count": count, "dt": step_length(self._recording, 1), "sensor": self._recording.sensor}
        return {"mean": mean, "cov": cov, **start, **plain}

    def _noise_covs(self, step: int, observation: Float) -> dict[str, Float]:
        return dict(zip(COVS_OF_NOISE, (self._motion_cov(step), observation), strict=True))

    def _motion_cov(self, step: int) -> Float:
        """Return the noise of the motion of a step, in the size, unit and frame of the class."""
        if self._way.motion == "control" and self._way.predict.unit == "speed":
            return control_cov(self._recording, step)
        cov = increment_cov(self._recording, step)
        if self._way.motion == "control":
            return cov[np.ix_([0, 2], [0, 2])]
        return world_cov(self._recording, step, self._heading) if self._way.motion == "world" else cov

    def _found_names(self) -> tuple[str, str]:
        """Return the names of the attributes with state and covariance; the start replaces None."""
        for state, cov in product(STATES, COVS):
            if {state, cov} <= {name for name, value in vars(self._slam).items() if value is None}:
                setattr(self._slam, state, self._recording.prior_mean.copy())
                setattr(self._slam, cov, self._recording.prior_cov.copy())
            x, P = (numbers(getattr(self._slam, name, None)) for name in (state, cov))
            if x.size >= ROBOT and x.size % 2 and P.shape == (x.size, x.size):
                return state, cov
        given = ", ".join(f"{n} {np.shape(getattr(self._slam, n))}" for n in (*STATES, *COVS) if hasattr(self._slam, n))
        what = f"its attributes are not a state (3+2n,) and covariance (3+2n, 3+2n): {given}"
        raise UserCodeError(f"{what}; call them mu and Sigma, or x and P")

    def _start(self, roles: dict[str, str], count: int) -> None:
        """Set start pose and covariance where the constructor does not take them; bound variances of landmarks."""
        x, P = (numbers(getattr(self._slam, name)) for name in self.names)
        self._has_room = x.size > ROBOT and x.size >= ROBOT + 2 * count
        if "mean" not in roles.values():
            x.reshape(-1)[:ROBOT] = self._recording.prior_mean
        unseen = np.arange(ROBOT, len(P))
        P[unseen, unseen] = np.minimum(P[unseen, unseen], UNSEEN)
        if "cov" not in roles.values():
            P[:ROBOT, :ROBOT] = self._recording.prior_cov
        for name, value in zip(self.names, (x, P), strict=True):
            setattr(self._slam, name, value)

    def _numbered(self, scan: Observations) -> Observations:
        """Return the scan with numbers in the order of first observation instead of ids."""
        if scan.landmark is None:
            return scan
        numbers = np.array([self._number[name] for name in scan.landmark.tolist()], dtype=np.int64)
        self._seen = max(self._seen, int(numbers.max()) + 1)
        return scan._replace(landmark=numbers + self._way.first_id)


def _arc_remark(recording: Recording) -> list[str]:
    """Return a sentence on a class that moves on arcs."""
    bias = np.abs(recording.odometry[:, 0] * recording.odometry[:, 2]).max(initial=0.0) / 2
    what = "it moves on an arc in each step, where the recording moves straight ahead and turns afterwards"
    return [f"{what}: its prediction is biased by up to {bias:.2g} m a step"]


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
    swaps = (False, True) if {*roles, *_attribute_names(kind)} >= {*LETTERS} else (False,)
    shapes = ("flat", "column", "full", "full column") if "mean" in roles.values() else ("flat", "full")
    starts = product(predict_calls(predict), ("control", "body", "world"), swaps, shapes)

    def started(way: Way) -> _Run:
        return _Run(kind, recording, way)

    ways = [Way(call, size, swap, shape) for call, size, swap, shape in starts]
    way = best_of(ways, started, recording, is_blind=True)
    way = way._replace(is_arc=follows_arc(started(way), recording))
    calls = product((0, 1), update_calls(update, has_ids=has_ids))
    return best_of([way._replace(update=call, first_id=first) for first, call in calls], started, recording)
