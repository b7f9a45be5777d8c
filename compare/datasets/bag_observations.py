"""Observations of landmarks in the messages of a bag, in the frame of the robot."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.datasets.bag_file import Bag, clock_checked, frame_of, header_stamp, seconds_of
from slamgauge.compare.datasets.bag_mapping import BagMapping, ObservationsTopic, Paths
from slamgauge.compare.datasets.imported_log import numbered, with_sigmas
from slamgauge.compare.datasets.static_transforms import StaticTransforms
from slamgauge.errors import UserError
from slamgauge.se2 import wrap
from slamgauge.sensors import SENSORS, Sensor, inverse, inverse_jacobian, jacobian, predict

MARKER_ADD = 0  # action of a visualization_msgs/Marker that exists; others delete it
LEVEL = 1e-9  # largest entry of a rotation that tilts bearings out of the plane


class Observations(NamedTuple):
    """Observations in the frame of the robot, in the order of their stamps.

    Attributes:
        sensor: name of the sensor.
        stamps: (M,) [s].
        landmark: (M,) ids; -1 without one.
        values: (M, d).
        covs: (M, d, d).
        notes: sentences about dropped content.
        ids: number of each id that is a text.
    """

    sensor: Sensor
    stamps: Float
    landmark: Int
    values: Float
    covs: Float
    notes: tuple[str, ...]
    ids: dict[str, int]


class _Row(NamedTuple):
    """An element of a message: times [ns], frame, id, the values in the order of the paths, and the covariance."""

    stamp: int
    received: int
    frame: str
    id: int | str | None
    values: list[float]
    covariance: Float


def read_observations(bag: Bag, mapping: BagMapping, base: str) -> Observations:
    """Read the observations of a mapping whose topic and paths are complete.

    Args:
        bag: the bag.
        mapping: its settings.
        base: frame of the robot.

    Raises:
        UserError: a path does not exist, a frame is not connected to `base`, an id is not stated, or noise is missing.
    """
    section = mapping.observations
    where = f"{bag.path}: {section.topic}"
    sensor: Sensor = "position" if section.x else "range-bearing" if section.range else "bearing"
    groups = Counter[str]()
    rows = list(_rows(bag, section, groups))
    received = np.array([row.received for row in rows], dtype=np.int64)
    stamps, notes = received, ()
    if mapping.frames.clock == "header":
        stamps, notes = clock_checked(where, np.array([row.stamp for row in rows], dtype=np.int64), received)
    if len(groups) > 1:
        notes += (f"{section.topic}: " + ", ".join(f"{count} {name}" for name, count in groups.items()),)
    order = np.argsort(stamps, kind="stable")
    rows, stamps = [rows[each] for each in order], stamps[order]
    values, covs = _in_base(rows, sensor, StaticTransforms(bag, mapping.transforms, base), base, where)
    landmark, ids = numbered([row.id for row in rows], mapping.ids, where)
    if min(landmark, default=0) < -1:
        raise UserError(f"{where}: the id {min(landmark)} is negative; ids start at 0, and -1 stands for a missing id")
    covs = _observation_noise(covs, sensor, mapping, where)
    return Observations(sensor, seconds_of(stamps), landmark, values, covs, notes, ids)


def _rows(bag: Bag, section: ObservationsTopic, groups: Counter[str]) -> Iterator[_Row]:
    """Yield the elements of all messages, and count them by the array that they are in."""
    paths = [each for each in (section.x, section.y, section.z, section.range, section.bearing) if each]
    arrays = {name: getter(name) for name in _listed(section.array)} or {"": lambda content: [content]}
    values, ids = [getter(path) for path in paths], [getter(path) for path in _listed(section.id)]
    covariance = None if section.covariance is None else getter(section.covariance)
    pattern = None if section.pattern is None else re.compile(section.pattern)
    for received, content in bag.messages(section.topic or ""):
        stamp, frame = header_stamp(content), frame_of(content)
        try:
            for name, array in arrays.items():
                for element in array(content):
                    if getattr(element, "action", MARKER_ADD) != MARKER_ADD:
                        continue
                    found = _first(ids, element)
                    if pattern is not None:
                        match = pattern.search(str(found))
                        if match is None:
                            continue
                        found = match[1] if pattern.groups else match[0]
                    groups[name] += 1
                    yield _Row(
                        stamp or header_stamp(element),
                        received,
                        frame or frame_of(element),
                        found,
                        [float(get(element)) for get in values],
                        np.zeros(0) if covariance is None else np.asarray(covariance(element), dtype=np.float64),
                    )
        except (AttributeError, IndexError, TypeError) as error:
            raise UserError(
                f"{bag.path}: {section.topic}: a path does not fit its messages: {error}; correct it"
            ) from None


def getter(path: str) -> Callable[[Any], Any]:
    """Return a function that follows a path of names and indices with dots between them."""
    steps = [int(word) if word.isdigit() else word for word in path.split(".")]

    def get(content: Any) -> Any:
        for step in steps:
            content = content[step] if isinstance(step, int) else getattr(content, step)
        return content

    return get


def _listed(paths: Paths | None) -> list[str]:
    return [paths] if isinstance(paths, str) else paths or []


def _first(getters: list[Callable[[Any], Any]], element: Any) -> int | str | None:
    """Return the first id that exists and is not an empty text; None without any."""
    for get in getters:
        try:
            found = get(element)
        except (AttributeError, IndexError):
            continue
        if found != "":
            return found if isinstance(found, str) else int(found)
    return None


def _in_base(
    rows: list[_Row], sensor: Sensor, transforms: StaticTransforms, base: str, where: str
) -> tuple[Float, Float]:
    """Return values (M, d) and covariances (M, d, d) in the frame `base`; covariances that are missing are NaN."""
    dim = SENSORS[sensor].dim
    values, covs = np.empty((len(rows), dim)), np.full((len(rows), dim, dim), np.nan)
    frames = np.array([row.frame for row in rows])
    for frame in dict.fromkeys(frames.tolist()):
        pose, here = transforms.pose(frame, base), np.flatnonzero(frames == frame)
        measured = np.array([rows[each].values for each in here])
        cov = _matrices([rows[each].covariance for each in here], sensor, where)
        if sensor == "position":
            points = np.pad(measured, ((0, 0), (0, 3 - measured.shape[1])))
            values[here] = (points @ pose[:3, :3].T + pose[:3, 3])[:, :2]
            covs[here] = (pose[:3, :3] @ cov @ pose[:3, :3].T)[:, :2, :2]
        elif np.array_equal(pose, np.eye(4)):
            values[here], covs[here] = measured, cov
        else:
            values[here], covs[here] = _turned(sensor, measured, cov, pose, f"{where}: {frame}")
    angles = SENSORS[sensor].is_angle
    return np.where(angles, wrap(values), values), covs


def _turned(sensor: Sensor, measured: Float, covs: Float, pose: Float, where: str) -> tuple[Float, Float]:
    """Return values (m, d) with bearings, and their covariances, from a sensor at a pose (4, 4) of the base frame."""
    if np.abs(pose[2, :2]).max() > LEVEL:
        raise UserError(f"{where}: is tilted, and bearings are in its plane; map x, y and z instead")
    if sensor == "bearing" and np.abs(pose[:2, 3]).max() > 0.0:
        raise UserError(
            f"{where}: is not at the base, and bearings cannot be moved; give --set frames.base={where.split()[-1]}"
        )
    turn = pose[:2, :2]
    moved = inverse(sensor, measured) @ turn.T + pose[:2, 3]
    change = jacobian(sensor, moved) @ turn @ inverse_jacobian(sensor, measured)
    if sensor == "bearing":
        return predict(sensor, moved), covs
    return predict(sensor, moved), change @ covs @ change.swapaxes(1, 2)


def _matrices(flat: list[Float], sensor: Sensor, where: str) -> Float:
    """Return covariances (m, d, d), for positions (m, 3, 3), from those of messages; NaN if they are not stated.

    A position has 36 numbers (of a pose), 9 (x, y, z) or 4 (x, y), row by row. ROS states an unknown covariance by
    zeros, or by a first number of -1.
    """
    size = 3 if sensor == "position" else SENSORS[sensor].dim
    made = np.full((len(flat), size, size), np.nan)
    if not flat or not flat[0].size:
        return made
    side = round(flat[0].size ** 0.5)
    if side * side != flat[0].size or any(len(each) != len(flat[0]) for each in flat):
        raise UserError(f"{where}: a covariance of {flat[0].size} numbers; give the path of a square matrix")
    square, used = np.array(flat).reshape(-1, side, side), min(side, size)
    stated = (square[:, 0, 0] > 0.0) & np.isfinite(square).all(axis=(1, 2))
    made[stated] = 0.0
    made[stated, :used, :used] = square[stated, :used, :used]
    return made


def _observation_noise(covs: Float, sensor: Sensor, mapping: BagMapping, where: str) -> Float:
    """Return covariances (M, d, d) in which stated standard deviations replace variances and their correlations."""
    covs = with_sigmas(covs, [getattr(mapping.noise, name) for name in SENSORS[sensor].sigmas])
    missing = np.isnan(covs).any(axis=(1, 2))
    if missing.any():
        names = " ".join(f"noise.{name}=SIGMA" for name in dict.fromkeys(SENSORS[sensor].sigmas))
        what = f"{missing.sum()} of {len(covs)} observations have no covariance"
        raise UserError(f"{where}: {what}; state the noise: --set {names}")
    return covs
