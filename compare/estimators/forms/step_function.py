"""Step functions of the exercise and of PythonRobotics: `ekf_slam(xEst, PEst, u, y) -> xEst, PEst`.

State (3+2n, 1), u (2, 1) = speed [m/s] and yaw rate [rad/s], y (m, 3) = range [m], bearing [rad], id. The function
reads globals of its module: DT [s], Q (2, 2) of u, Py (2, 2), KNOWN_DATA_ASSOCIATION (`step_settings`). An increment
(dx, 0, dtheta) with covariance C over DT is exactly u = (dx, dtheta) / DT with Q = C / DT^2.

Variants take settings, and other globals of their modules, as parameters of those names. Bearing-only variants take and
return a third value (rays and their weights), and y = [bearing, id], or [range, bearing, id] with a range of NaN.

With known association the n-th landmark of the state has the id that was observed n-th. If a filter maps otherwise
(several members for a landmark, duplicates, no landmarks at first), ids are unknown, and the estimate has no map.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.signatures import Callee, Form, Noise, parameters, required
from slamgauge.compare.estimators.forms.step_settings import STATE_AND_INPUT, Settings, names_read, numbers, step_length
from slamgauge.compare.estimators.user_errors import UserCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.sensors import SENSORS

PLAIN = (bool, int, float, complex, str, type(None), np.ndarray, np.generic)  # types of globals that start as they were


class Column(np.ndarray):
    """A column (n, 1) whose elements convert to numbers, as those of all arrays did before numpy 2.4.

    Files of the exercise write `float(u[0])` and `math.sin(x[2])`. State, u and y are columns in every run, and so is
    what the function calculates from them. The covariance begins as a plain array: its products are faster.
    """

    __array_priority__ = 1.0

    def __float__(self) -> float:
        """Return the only element; raise ValueError if the array has several."""
        return float(self.item())

    def __int__(self) -> int:
        """Return the only element, rounded towards zero; raise ValueError if the array has several."""
        return int(float(self))


class Numbers(Column):
    """A column whose elements are numbers: numpy takes no u[0] of shape (1,) in a list of numbers."""

    def __getitem__(self, key: Any) -> Any:
        """Return the element of a row, or any other part as usual."""
        return self.item(key) if isinstance(key, int) else super().__getitem__(key)


def is_step_function(given: object) -> bool:
    """Return whether a callable has the parameters of a step function."""
    return callable(given) and not isinstance(given, type) and len(required(given)) >= STATE_AND_INPUT


def lacks(given: Callee) -> str:
    """Return what a callable with the parameters of a step function lacks; empty if it is one."""
    if "DT" in names_read(given) or "DT" in (each.name for each in parameters(given)):
        return ""
    remedy = "write DT where it, or a function that it calls, has this length"
    return f"DT, the length of a step [s], which it reads nowhere: {remedy}"


@dataclass
class StepFunction(Form):
    """A step function as an estimator; every run finds the globals of its module as they were before."""

    function: Callee
    noise: Noise = "recording"  # assumed noise: that of the recording, or that of its file

    def __post_init__(self) -> None:
        names = ", ".join(each.name for each in parameters(self.function))
        self.words = f"step function of the exercise ({names})"

    def __call__(self, recording: Recording, kind_of_u: type[Column] = Column) -> Estimate:
        """Run the function over a recording; for a scan at step 0, u and Q are zero.

        Recordings that u, y and globals cannot express are refused.
        """
        _require_expressible(recording)
        space: dict[str, Any] = getattr(self.function, "__globals__", {})
        before = dict(space)
        space.update({name: deepcopy(value) for name, value in before.items() if _is_data(value)})
        try:
            return self._run(recording, kind_of_u)
        except ValueError as error:
            if kind_of_u is Numbers or "inhomogeneous" not in str(error):
                raise
        finally:
            space.update(before)
            for name in space.keys() - before.keys():
                del space[name]
        return self(recording, Numbers)  # from the start, with globals as they were

    def _run(self, recording: Recording, kind_of_u: type[Column]) -> Estimate:
        settings = Settings(self.function, recording, self.noise)
        self.remarks, self.replaces_noise = [*settings.remarks()], settings.replaces_noise
        passed = settings.passed_at_first()
        needed = [name for name in passed if name in required(self.function)]
        poses, covs = np.empty((recording.steps + 1, 3)), np.empty((recording.steps + 1, 3, 3))
        seconds, ids, is_named = np.zeros(recording.steps + 1), list[int](), True
        poses[0], covs[0] = state, cov = recording.prior_mean, recording.prior_cov
        x: Any = recording.prior_mean.reshape(3, 1).copy()
        P: Any = recording.prior_cov.copy()
        for step, scan in enumerate(recording.scans()):
            if step == 0 and not len(scan.value):
                continue
            settings.set(step, scan, heading=float(np.asarray(x).flat[2]))
            moved = recording.odometry[step - 1, [0, 2]] if step else np.zeros(2)
            u = moved.reshape(2, 1) / step_length(recording, step)
            x = x.view(Column) if type(x) is np.ndarray else x  # others as they are
            y = _observed(scan, settings.shows_ids, settings.columns)
            start = perf_counter()
            returned = self.function(x, P, u.view(kind_of_u), y.view(Column), **settings.named() | passed)
            seconds[step] = perf_counter() - start
            if not isinstance(returned, tuple | list) or len(returned) < 2:
                what = "one array" if isinstance(returned, np.ndarray) else f"a {type(returned).__name__}"
                raise UserCodeError(f"the step function returned {what}; return state and covariance")
            x, P, *more = returned
            state, cov = _checked(step, x, P)
            poses[step], covs[step] = state[:3], cov[:3, :3]
            if settings.shows_ids and scan.landmark is not None:
                ids += [name for name in dict.fromkeys(scan.landmark.tolist()) if name not in ids]
                is_named = is_named and len(ids) == (len(state) - 3) // 2
            if 0 < len(more) < len(needed):
                raise UserCodeError(f"it returns {len(more)} of the values for {', '.join(needed)}; return all of them")
            passed |= dict(zip(passed, more, strict=False))
        if not settings.shows_ids and recording.landmark is None:  # with ids, 0, 1, ... would be ids of the recording
            ids = [*range((len(state) - 3) // 2)]
        return _estimate(recording, (poses, covs, seconds), ids if is_named else [], state, cov)


def _estimate(
    recording: Recording, path: tuple[Float, Float, Float], ids: list[int], state: Float, cov: Float
) -> Estimate:
    """Return the estimate with a path (poses, covariances, seconds) and the landmarks `ids` of the last state."""
    poses, pose_covs, seconds = path
    map_covs = np.array([cov[at : at + 2, at : at + 2] for at in 3 + 2 * np.arange(len(ids))]).reshape(-1, 2, 2)
    is_whole = recording.landmark is not None and np.isin(recording.landmark, ids).all()
    return Estimate(
        kind="filtered",
        poses=poses,
        pose_covs=(pose_covs + pose_covs.swapaxes(1, 2)) / 2,
        landmark_ids=np.array(ids, np.int64),
        landmarks=state[3 : 3 + 2 * len(ids)].reshape(-1, 2),
        landmark_covs=(map_covs + map_covs.swapaxes(1, 2)) / 2,
        association=recording.landmark if is_whole else None,
        seconds=seconds,
    )


def _checked(step: int, state: object, cov: object) -> tuple[Float, Float]:
    """Return copies (3+2n,) and (3+2n, 3+2n) of state and covariance, whatever shape the state has."""
    x, P = numbers(state), numbers(cov)
    size = x.size
    if size < 3 or not size % 2 or P.shape != (size, size):
        what = f"xEst {x.shape} and PEst {P.shape}"
        raise UserCodeError(f"step {step}: returned {what}; return (3+2n, 1) and (3+2n, 3+2n)")
    for name, array in (("xEst", x), ("PEst", P)):
        if not np.isfinite(array).all():
            raise UserCodeError(f"step {step}: {name} is not finite from here on; look for what divides by zero")
    return x.reshape(-1), P


def _is_data(value: object) -> bool:
    """Return whether a value consists of numbers, texts and arrays."""
    if isinstance(value, dict):
        return all(_is_data(each) for pair in value.items() for each in pair)
    if isinstance(value, list | tuple | set | frozenset):
        return all(map(_is_data, value))
    return isinstance(value, PLAIN)


def _observed(scan: Observations, shows_ids: bool, width: int) -> Float:
    """Return the scan as y (m, 3) or (m, 2): unknown ranges are NaN, unknown ids in the last column are -1."""
    ids = scan.landmark if shows_ids and scan.landmark is not None else np.full(len(scan.value), -1)
    y = np.column_stack([scan.value, ids.astype(np.float64)])
    return np.hstack([np.full((len(y), width - y.shape[1]), np.nan), y])


def _require_expressible(recording: Recording) -> None:
    """Refuse a recording that u and y cannot express."""
    if not SENSORS[recording.sensor].has_bearing:
        raise UserCodeError("a step function of the exercise takes ranges and bearings; this recording has positions")
    sideways = np.flatnonzero(recording.odometry[:, 1])
    if len(sideways):
        step, slip = sideways[0] + 1, recording.odometry[sideways[0], 1]
        what = f"step {step} moves {slip:.3g} m sideways, which u = [speed, yaw rate] cannot express"
        raise UserCodeError(f"{what}; bring another form, an online class for instance")
