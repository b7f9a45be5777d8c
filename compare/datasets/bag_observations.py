"""Observations of landmarks in the messages of a bag, in the frame of the robot."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.bag_file import NANOSECOND, Bag, frame_of, header_stamp
from slamgauge.compare.datasets.imported_log import Observed, with_sigmas
from slamgauge.compare.datasets.log_settings import BagMapping, ObservationsTopic, Paths
from slamgauge.compare.storage.trajectories import rotations
from slamgauge.errors import UserError
from slamgauge.se2 import pose_rotation, wrap
from slamgauge.sensors import SENSORS, Sensor, inverse, inverse_jacobian, jacobian, predict

MARKER_ADD = 0  # action of a visualization_msgs/Marker that exists; others delete it
LEVEL = 1e-9  # largest entry of a rotation that tilts bearings out of the plane
STATIC = "/tf_static"
Getter = Callable[[Any], Any]
Frames = dict[str, tuple[str, Float]]  # the parent of a frame, and its pose (4, 4) in it


class _Row(NamedTuple):
    """An element of a message: times [ns], frame, id, the values in the order of the paths, and the covariance."""

    times: tuple[int, int]
    frame: str
    id: int | str | None
    values: list[float]
    covariance: Float


def read_observations(bag: Bag, mapping: BagMapping, notes: list[str]) -> Observed:
    """Read the observations of a mapping whose topic, paths and base frame are complete, and add notes."""
    section, where = mapping.observations, f"{bag.path}: {mapping.observations.topic}"
    sensor: Sensor = "position" if section.x else "range-bearing" if section.range else "bearing"
    rows = list(_rows(bag, section))
    stamps, order = bag.in_order(section.topic or "", [row.times for row in rows], notes)
    rows, names = [rows[each] for each in order], SENSORS[sensor].sigmas
    values, covs = _in_base(rows, sensor, _frames(bag, mapping), mapping.frames.base or "", where)
    covs = with_sigmas(covs, [getattr(mapping.noise, name) for name in names])
    missing = np.isnan(covs).any(axis=(1, 2))
    if missing.any():
        needed = " ".join(f"noise.{name}=SIGMA" for name in dict.fromkeys(names))
        what = f"{missing.sum()} of {len(covs)} observations have no covariance"
        raise UserError(f"{where}: {what}; state the noise: --set {needed}")
    return Observed(sensor, NANOSECOND * stamps, [row.id for row in rows], values, covs)


def _rows(bag: Bag, section: ObservationsTopic) -> Iterator[_Row]:
    """Yield the elements of all messages."""
    values = [_getter(path) for path in (section.x, section.y, section.z, section.range, section.bearing) if path]
    arrays = [_getter(path) for path in _listed(section.array)] or [lambda content: [content]]
    ids = [_getter(path) for path in _listed(section.id)]
    covariance = _getter(section.covariance) if section.covariance else lambda _: ()
    try:
        pattern = re.compile(section.pattern or "(.*)")
    except re.error as error:
        raise UserError(f"observations.pattern: {section.pattern!r}: {error}; correct it") from None
    for received, content in bag.messages(section.topic or ""):
        stamp, frame = header_stamp(content), frame_of(content)
        try:
            for element in chain.from_iterable(array(content) for array in arrays):
                name = _first(ids, element)
                match = pattern.search(str(name))
                if match is None or getattr(element, "action", MARKER_ADD) != MARKER_ADD:
                    continue
                yield _Row(
                    (stamp or header_stamp(element), received),
                    frame or frame_of(element),
                    match[pattern.groups and 1] if section.pattern else name,
                    [float(get(element)) for get in values],
                    np.asarray(covariance(element), dtype=np.float64),
                )
        except (AttributeError, IndexError, TypeError) as error:
            what = f"a path does not fit its messages: {error}"
            raise UserError(f"{bag.path}: {section.topic}: {what}; correct it") from None


def _getter(path: str) -> Getter:
    """Return a function that follows a path of names and indices with dots between them."""
    steps = [int(word) if word.isdigit() else word for word in path.split(".")]

    def get(content: Any) -> Any:
        for step in steps:
            content = content[step] if isinstance(step, int) else getattr(content, step)
        return content

    return get


def _listed(paths: Paths | None) -> list[str]:
    return [paths] if isinstance(paths, str) else paths or []


def _first(getters: list[Getter], element: Any) -> int | str | None:
    """Return the first id that exists and is not an empty text; None without any."""
    for get in getters:
        with suppress(AttributeError, IndexError):
            found = get(element)
            if found != "":
                return found if isinstance(found, str) else int(found)
    return None


def _frames(bag: Bag, mapping: BagMapping) -> Frames:
    """Return the static transforms of a bag; stated poses in the base frame replace them."""
    frames: Frames = {}
    for _, content in bag.messages(STATIC) if STATIC in bag.topics else ():
        for each in content.transforms:
            place, turn, pose = each.transform.translation, each.transform.rotation, np.eye(4)
            pose[:3, :3] = rotations(np.array([[turn.x, turn.y, turn.z, turn.w]]))[0]
            pose[:3, 3] = place.x, place.y, place.z
            frames[each.child_frame_id.removeprefix("/")] = (frame_of(each), pose)
    for frame, (x, y, heading) in mapping.transforms.items():
        pose = np.eye(4)
        pose[:3, :3], pose[:2, 3] = pose_rotation(heading), (x, y)
        frames[frame] = (mapping.frames.base or "", pose)
    return frames


def _pose_in(base: str, frame: str, frames: Frames, where: str) -> Float:
    """Return the pose (4, 4) of a frame in the frame `base`."""
    found = list[tuple[str, Float]]()
    for name in (frame, base):
        root, pose = name, np.eye(4)
        for _ in range(len(frames)):  # more steps would be a circle
            if root in frames:
                root, step = frames[root]
                pose = step @ pose
        found.append((root, pose))
    (root, pose), (root_of_base, pose_of_base) = found
    if root != root_of_base or root in frames:
        remedy = f"give its pose with --set transforms.{frame}=[x,y,heading], or another frames.base"
        raise UserError(f"{where}: no static transform from {frame} to {base} on {STATIC}; {remedy}")
    return np.linalg.inv(pose_of_base) @ pose


def _in_base(rows: list[_Row], sensor: Sensor, frames: Frames, base: str, where: str) -> tuple[Float, Float]:
    """Return values (M, d) and covariances (M, d, d) in the frame `base`; covariances that are missing are NaN.

    A frame without a name is `base` itself.
    """
    model = SENSORS[sensor]
    values, covs = np.empty((len(rows), model.dim)), np.full((len(rows), model.dim, model.dim), np.nan)
    names = np.array([row.frame or base for row in rows])
    for frame in dict.fromkeys(names.tolist()):
        here = np.flatnonzero(names == frame)
        measured, cov = np.array([rows[each].values for each in here]), _matrices([rows[each] for each in here], where)
        pose = np.eye(4) if frame == base else _pose_in(base, frame, frames, where)
        if sensor == "position":
            points = np.pad(measured, ((0, 0), (0, 3 - measured.shape[1])))
            values[here] = (points @ pose[:3, :3].T + pose[:3, 3])[:, :2]
            covs[here] = (pose[:3, :3] @ cov @ pose[:3, :3].T)[:, :2, :2]
            continue
        values[here], covs[here] = measured, cov[:, : model.dim, : model.dim]
        if frame == base:
            continue
        if np.abs(pose[2, :2]).max() > LEVEL:
            raise UserError(f"{where}: {frame} is tilted, and bearings are in its plane; map x, y and z instead")
        if sensor == "bearing" and pose[:2, 3].any():
            what = f"{frame} is not at the base, and bearings cannot be moved"
            raise UserError(f"{where}: {what}; give --set frames.base={frame}")
        moved = inverse(sensor, measured) @ pose[:2, :2].T + pose[:2, 3]
        change = jacobian(sensor, moved) @ pose[:2, :2] @ inverse_jacobian(sensor, measured)
        values[here] = predict(sensor, moved)
        if sensor != "bearing":
            covs[here] = change @ covs[here] @ change.swapaxes(1, 2)
    return np.where(model.is_angle, wrap(values), values), covs


def _matrices(rows: list[_Row], where: str) -> Float:
    """Return covariances (m, 3, 3) of the first numbers, from those of messages; NaN if they are not stated.

    A position has 36 numbers (of a pose), 9 (x, y, z) or 4 (x, y), row by row. ROS states an unknown covariance by
    zeros, or by a first number of -1.
    """
    made, sizes = np.full((len(rows), 3, 3), np.nan), {row.covariance.size for row in rows}
    side = round(max(sizes) ** 0.5)
    if {side**2} != sizes:
        raise UserError(f"{where}: a covariance of {max(sizes)} numbers; give the path of a square matrix")
    if side:
        square, used = np.array([row.covariance for row in rows]).reshape(-1, side, side), min(side, 3)
        stated = (square[:, 0, 0] > 0.0) & np.isfinite(square).all(axis=(1, 2))
        made[stated] = 0.0
        made[stated, :used, :used] = square[stated, :used, :used]
    return made
