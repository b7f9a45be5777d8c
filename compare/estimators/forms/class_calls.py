"""Ways to call `predict` and `update` of an online class: arguments by parameter names, else alternatives to try."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.names import Roles, role_of
from slamgauge.compare.estimators.forms.octave_conventions import CourseObservation, turn
from slamgauge.compare.estimators.forms.signatures import called, parameters, required
from slamgauge.compare.estimators.user_code import UserCodeError
from slamgauge.recording import Observations

MOTION: Roles = {
    "speed": ("v vel velocity speed linear", "t x lin m mps forward"),
    "yaw rate": ("w omega angular yawrate rate ang om", "t vel velocity yaw rps speed"),
    "time": ("dt ts dtime timestep step", "time"),
    "forward": ("d dd ds dx s dist distance", "forward"),
    "sideways": ("dy", ""),
    "turn": ("dtheta dth dyaw dphi turn", ""),
    "increment": ("increment odometry odom odo delta motion dpose change", "z pose"),
    "cov": ("cov covs covariance noise Q R sigma", "u motion odometry"),
}
OBSERVATION: Roles = {
    "range": ("r range rng dist distance", "z meas measured"),
    "bearing": ("b bearing phi angle theta beta", "z meas measured"),
    "id": (
        "id ids j i c lid lm idx index indices correspondences associations landmark landmarks",
        "t marker tag feature",
    ),
    "cov": ("cov covs covariance noise Q R", "meas measurement observation"),
}

Motion = tuple[Float, Float, float]  # increment (3,), its covariance (3, 3), length of the step [s]
Arguments = dict[str, Any]  # by name


class Call(NamedTuple):
    """A way to call a method.

    Attributes:
        words: what the method receives.
        arguments: makes the arguments of each call from a motion or a scan.
        unit: for `predict`: what a 2 x 2 noise belongs to: `speed` (and yaw rate) or `increment`.
        has_ids: for `update`: whether it receives ids.
    """

    words: str
    arguments: Callable[[Any], Iterable[Arguments]]
    unit: str = "speed"
    has_ids: bool = True

    def run(self, method: Callable[..., object], given: Motion | Observations) -> None:
        """Call the bound method with copies of a motion or a scan."""
        for each in self.arguments(given):
            called(partial(method, **{name: v.copy() if isinstance(v, np.ndarray) else v for name, v in each.items()}))


class Way(NamedTuple):
    """How a class is constructed and called.

    Attributes:
        predict: call of `predict`.
        motion: noise of the motion: `control` (2, 2), or that of the increment (3, 3) in the frame `body` or `world`.
        is_swapped: whether R is the noise of the motion, and Q that of observations.
        state_shape: `flat` or `column` (3,) or (3, 1), with `full` in front with room for all landmarks.
        update: call of `update`; None leaves it out.
        first_id: number of the landmark that is observed first.
        is_arc: whether `predict` moves on an arc.
    """

    predict: Call
    motion: str
    is_swapped: bool
    state_shape: str
    update: Call | None = None
    first_id: int = 0
    is_arc: bool = False


ARGUMENTS: dict[str | None, Callable[[Motion], Any]] = {
    "speed": lambda m: float(m[0][0] / m[2]),
    "yaw rate": lambda m: float(m[0][2] / m[2]),
    "time": lambda m: m[2],
    "forward": lambda m: float(m[0][0]),
    "sideways": lambda m: float(m[0][1]),
    "turn": lambda m: float(m[0][2]),
    "cov": lambda m: m[1],
}
INPUTS: dict[str, tuple[str, Callable[[Motion], Float]]] = {
    "[v, w]": ("speed", lambda m: m[0][[0, 2]] / m[2]),
    "[dx, dy, dtheta]": ("increment", lambda m: m[0]),
    "[distance, turn]": ("increment", lambda m: m[0][[0, 2]]),
    "[r1, t, r2]": ("increment", lambda m: turn(m[0])),
    "[v, w, dt]": ("speed", lambda m: np.array([*m[0][[0, 2]] / m[2], m[2]])),
}
ROWS: dict[str, Callable[[list[int], Float], Any]] = {
    "rows [range, bearing, id]": lambda ids, z: np.column_stack([z, ids]),
    "tuples (range, bearing, id)": lambda ids, z: [(*each, j) for j, each in zip(ids, z.tolist(), strict=True)],
    "observations (id, range, bearing)": lambda ids, z: [
        CourseObservation(j, *each) for j, each in zip(ids, z.tolist(), strict=True)
    ],
    "rows [id, range, bearing]": lambda ids, z: np.column_stack([ids, z]),
    "a dict from id to [range, bearing]": lambda ids, z: dict(zip(ids, z.copy(), strict=True)),
    "tuples (id, [range, bearing])": lambda ids, z: [*zip(ids, z.copy(), strict=True)],
}


def predict_calls(method: object) -> list[Call]:
    """Return ways to call `predict`, the most usual first.

    Raises:
        UserCodeError: a required parameter has no known name.
    """
    roles = {each.name: role_of(each.name, MOTION) for each in parameters(method) if each.name != "self"}
    fixed = {name: ARGUMENTS[role] for name, role in roles.items() if role in ARGUMENTS}
    unit = "increment" if {*roles.values()} & {"forward", "sideways", "turn"} else "speed"
    unknown = [name for name in roles if name not in fixed and name in required(method)]
    if len(unknown) > 1:
        raise UserCodeError(f"predict needs {' and '.join(unknown)}; use the names v, w, dt, or u, dt")
    if not unknown:
        return [_motion_call(f"predict({', '.join(fixed)})", fixed, unit)]
    calls = [
        _motion_call(f"predict with {unknown[0]} = {shape}{words}", {**fixed, unknown[0]: value}, unit)
        for words, (unit, u) in INPUTS.items()
        for shape, value in (("", u), ("column ", _column(u)))
    ]
    return sorted(calls, key=lambda call: roles[unknown[0]] == "increment" and call.unit == "speed")


def _column(u: Callable[[Motion], Float]) -> Callable[[Motion], Float]:
    return lambda motion: u(motion).reshape(-1, 1)


def _motion_call(words: str, values: dict[str, Callable[[Motion], Any]], unit: str) -> Call:
    def arguments(motion: Motion) -> list[Arguments]:
        return [{name: value(motion) for name, value in values.items()}]

    return Call(words, arguments, unit)


def update_calls(method: object, *, has_ids: bool) -> list[Call]:
    """Return ways to call `update`, the most usual first.

    Raises:
        UserCodeError: a required parameter has no known name, or the method needs ids that the recording lacks.
    """
    known = {each.name: role_of(each.name, OBSERVATION) for each in parameters(method) if each.name != "self"}
    roles = {name: role for name, role in known.items() if role in ("cov", "id") or name in required(method)}
    covs = [name for name, role in roles.items() if role == "cov"]
    ids = [name for name, role in roles.items() if role == "id"]
    rest = [name for name in roles if name not in (*covs, *ids)]
    if ids and not has_ids:
        raise UserCodeError(f"update needs {ids[0]}; give a recording with ids")
    if [roles[name] for name in rest] == ["range", "bearing"]:
        return [_per_landmark(ids, covs, rest)]
    if len(rest) != 1 or len(ids) > 1:
        raise UserCodeError(f"update needs {', '.join(roles)}; use the names z, id, or r, b, id")
    if not ids:
        whole = [_rows(rest[0], covs, words) for words in ROWS] if has_ids else []
        single = [_rows(rest[0], covs, words, is_single=True) for words in [*ROWS][:3]] if has_ids else []
        return [*whole, *single, _whole("associates on its own", rest, covs)]
    each = [_per_landmark(ids, covs, rest), _per_landmark(ids, covs, rest, column=True)]
    whole = _whole(f"{ids[0]} (m,)", rest, covs, ids)
    return [whole, *each] if ids[0].endswith("s") or rest[0].endswith("s") else [*each, whole]


def _ids_of(scan: Observations) -> list[int]:
    return [-1] * len(scan.value) if scan.landmark is None else scan.landmark.tolist()


def _per_landmark(ids: list[str], covs: list[str], rest: list[str], *, column: bool = False) -> Call:
    """Return the call for each observation: with an array (2,) or (2, 1), or with two numbers."""

    def arguments(scan: Observations) -> Iterator[Arguments]:
        for number, value, cov in zip(_ids_of(scan), scan.value, scan.cov, strict=True):
            z = value.tolist() if len(rest) == 2 else [value.reshape(2, 1) if column else value]
            yield dict(zip(rest, z, strict=True)) | dict.fromkeys(ids, number) | dict.fromkeys(covs, cov)

    shape = " (2, 1)" if column else ""
    return Call(f"update({', '.join([*ids, *rest])}{shape}) per landmark", arguments, has_ids=bool(ids))


def _whole(words: str, rest: list[str], covs: list[str], ids: Sequence[str] = ()) -> Call:
    """Return the call with all values of a scan (m, 2), and its ids (m,) if they have a parameter."""

    def arguments(scan: Observations) -> list[Arguments]:
        named = dict.fromkeys(rest, scan.value) | dict.fromkeys(ids, np.array(_ids_of(scan)))
        return [named | dict.fromkeys(covs, scan.cov[0])]

    return Call(f"update with {rest[0]} (m, 2), {words}", arguments, has_ids=bool(ids))


def _rows(name: str, covs: list[str], words: str, *, is_single: bool = False) -> Call:
    """Return the call with rows that contain ids: all of a scan, or one after the other."""

    def arguments(scan: Observations) -> list[Arguments]:
        rows = ROWS[words](_ids_of(scan), scan.value)
        return [{name: each, **dict.fromkeys(covs, scan.cov[0])} for each in (rows if is_single else [rows])]

    return Call(f"update with {name} = {'one of ' if is_single else ''}{words}", arguments)
