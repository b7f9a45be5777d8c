"""Ways to call `predict` and `update` of an online class: arguments by parameter names, else alternatives to try."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.names import Roles, role_of
from slamgauge.compare.estimators.forms.octave_conventions import CourseObservation, turn
from slamgauge.compare.estimators.forms.signatures import called, parameters
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


class Call(NamedTuple):
    """A way to call a method.

    Attributes:
        words: what the method receives.
        run: calls the bound method, with a motion or with a scan.
        unit: for `predict`: what a 2 x 2 noise belongs to: `speed` (and yaw rate) or `increment`.
        has_ids: for `update`: whether it receives ids.
    """

    words: str
    run: Callable[[Any, Any], object]
    unit: str = "speed"
    has_ids: bool = True


class Way(NamedTuple):
    """How a class is constructed and called.

    Attributes:
        predict: call of `predict`.
        motion: noise of the motion: `control` (2, 2), or that of the increment (3, 3) in the frame `body` or `world`.
        is_swapped: whether R is the noise of the motion, and Q that of observations.
        state_shape: `flat` or `column` (3,) or (3, 1), with `full` in front with room for all landmarks.
        update: call of `update`; None leaves it out.
        first_id: number of the landmark that is observed first.
    """

    predict: Call
    motion: str
    is_swapped: bool
    state_shape: str
    update: Call | None = None
    first_id: int = 0


ARGUMENTS: dict[str | None, Callable[[Motion], Any]] = {
    "speed": lambda m: float(m[0][0] / m[2]),
    "yaw rate": lambda m: float(m[0][2] / m[2]),
    "time": lambda m: m[2],
    "forward": lambda m: float(m[0][0]),
    "sideways": lambda m: float(m[0][1]),
    "turn": lambda m: float(m[0][2]),
    "cov": lambda m: m[1].copy(),
}
INPUTS: dict[str, tuple[str, Callable[[Motion], Any]]] = {
    "[v, w]": ("speed", lambda m: m[0][[0, 2]] / m[2]),
    "column [v, w]": ("speed", lambda m: (m[0][[0, 2]] / m[2]).reshape(2, 1)),
    "[dx, dy, dtheta]": ("increment", lambda m: m[0].copy()),
    "column [dx, dy, dtheta]": ("increment", lambda m: m[0].reshape(3, 1).copy()),
    "[distance, turn]": ("increment", lambda m: m[0][[0, 2]]),
    "column [distance, turn]": ("increment", lambda m: m[0][[0, 2]].reshape(2, 1)),
    "[r1, t, r2]": ("increment", lambda m: turn(m[0])),
    "[v, w, dt]": ("speed", lambda m: np.array([*m[0][[0, 2]] / m[2], m[2]])),
}


def predict_calls(method: object) -> list[Call]:
    """Return ways to call `predict`, the most usual first.

    Raises:
        UserCodeError: a required parameter has no known name.
    """
    fixed: dict[str, Callable[[Motion], Any]] = {}
    open_, unit = "", "speed"
    for each in parameters(method):
        role = role_of(each.name, MOTION)
        if each.name == "self":
            continue
        if role in ARGUMENTS:
            fixed[each.name] = ARGUMENTS[role]
            unit = "increment" if role in ("forward", "sideways", "turn") else unit
        elif each.default is each.empty and not open_:
            open_ = each.name
        elif each.default is each.empty:
            raise UserCodeError(f"predict needs {open_} and {each.name}; use the names v, w, dt, or u, dt")
    if not open_:
        return [Call(f"predict({', '.join(fixed)})", _motion_call(fixed), unit)]
    order = sorted(INPUTS, key=lambda words: role_of(open_, MOTION) == "increment" and INPUTS[words][0] == "speed")
    return [
        Call(f"predict with {open_} = {words}", _motion_call({**fixed, open_: INPUTS[words][1]}), INPUTS[words][0])
        for words in order
    ]


def _motion_call(values: dict[str, Callable[[Motion], Any]]) -> Callable[[Any, Motion], object]:
    return lambda method, motion: called(lambda: method(**{name: value(motion) for name, value in values.items()}))


def update_calls(method: object, *, has_ids: bool) -> list[Call]:
    """Return ways to call `update`, the most usual first.

    Raises:
        UserCodeError: a required parameter has no known name, or the method needs ids that the recording lacks.
    """
    roles = {
        each.name: role
        for each in parameters(method)
        if (role := role_of(each.name, OBSERVATION)) in ("cov", "id")
        or (each.default is each.empty and each.name != "self")
    }
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
        return [*(_of_rows(rest[0], covs) if has_ids else ()), _of_values(rest[0], covs)]
    each = [_per_landmark(ids, covs, rest), _per_landmark(ids, covs, rest, column=True)]
    whole = [_of_arrays(ids[0], rest[0], covs)]
    return [*whole, *each] if ids[0].endswith("s") or rest[0].endswith("s") else [*each, *whole]


def _ids_of(scan: Observations) -> list[int]:
    return [] if scan.landmark is None else scan.landmark.tolist()


def _per_landmark(ids: list[str], covs: list[str], rest: list[str], *, column: bool = False) -> Call:
    def run(method: Any, scan: Observations) -> None:
        numbers = _ids_of(scan) if ids else [-1] * len(scan.value)
        for number, value, cov in zip(numbers, scan.value, scan.cov, strict=True):
            z = [value.reshape(2, 1).copy() if column else value.copy()] if len(rest) == 1 else value.tolist()
            arguments = {**dict(zip(rest, z, strict=True)), **dict.fromkeys(ids, number)}
            called(partial(method, **arguments, **{name: cov.copy() for name in covs}))

    shape = " (2, 1)" if column else ""
    return Call(f"update({', '.join([*ids, *rest])}{shape}) per landmark", run, has_ids=bool(ids))


def _of_arrays(id_name: str, z_name: str, covs: list[str]) -> Call:
    def run(method: Any, scan: Observations) -> None:
        arguments = {id_name: np.array(_ids_of(scan)), z_name: scan.value.copy(), **_covs(covs, scan)}
        called(lambda: method(**arguments))

    return Call(f"update({id_name} (m,), {z_name} (m, 2))", run)


def _of_values(name: str, covs: list[str]) -> Call:
    def run(method: Any, scan: Observations) -> None:
        called(lambda: method(**{name: scan.value.copy()}, **_covs(covs, scan)))

    return Call(f"update({name} (m, 2)), associates by itself", run, has_ids=False)


def _of_rows(name: str, covs: list[str]) -> Iterator[Call]:
    """Yield calls with rows that contain ids."""
    ways: dict[str, Callable[[Observations], Any]] = {
        "rows [range, bearing, id]": lambda s: np.column_stack([s.value, _ids_of(s)]),
        "tuples (range, bearing, id)": lambda s: [
            (r, b, j) for (r, b), j in zip(s.value.tolist(), _ids_of(s), strict=True)
        ],
        "observations (id, range, bearing)": lambda s: [
            CourseObservation(j, r, b) for (r, b), j in zip(s.value.tolist(), _ids_of(s), strict=True)
        ],
        "rows [id, range, bearing]": lambda s: np.column_stack([_ids_of(s), s.value]),
        "a dict from id to [range, bearing]": lambda s: dict(zip(_ids_of(s), s.value.copy(), strict=True)),
        "tuples (id, [range, bearing])": lambda s: [*zip(_ids_of(s), s.value.copy(), strict=True)],
    }
    for words, made in ways.items():
        yield Call(f"update with {name} = {words}", _whole(name, covs, made))
    for words in list(ways)[:3]:
        yield Call(f"update with {name} = one of {words}", _one_by_one(name, covs, ways[words]))


def _whole(name: str, covs: list[str], made: Callable[[Observations], Any]) -> Callable[[Any, Observations], object]:
    return lambda method, scan: called(lambda: method(**{name: made(scan)}, **_covs(covs, scan)))


def _one_by_one(
    name: str, covs: list[str], made: Callable[[Observations], Any]
) -> Callable[[Any, Observations], object]:
    def run(method: Any, scan: Observations) -> None:
        for row in made(scan):
            called(partial(method, **{name: row}, **_covs(covs, scan)))

    return run


def _covs(names: list[str], scan: Observations) -> dict[str, Float]:
    return {name: scan.cov[0].copy() for name in names}
