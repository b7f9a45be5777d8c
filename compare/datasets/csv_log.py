"""A robot's log in CSV files: odometry, observations and, if there is one, ground truth, each with its own stamps.

`csv_mapping` has the settings for reading the files. A folder that slamgauge exported, or that has the files of
`csv_folder`, needs no settings. Otherwise the files do not contain the noise, and it must be stated. The robot drives
arcs: it keeps its speed and yaw rate between two rows. `synchronisation` splits steps at observations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.datasets.csv_columns import Rows, read_columns
from slamgauge.compare.datasets.csv_mapping import ODOMETRIES, LogMapping, load_mapping
from slamgauge.compare.datasets.imported_log import Imported, diagonal_covariances, identified, of_file
from slamgauge.compare.datasets.synchronisation import Odometry, constant_twist, joined, require_turns
from slamgauge.compare.datasets.text_lines import require_bearings, require_order, require_ranges
from slamgauge.compare.storage.csv_folder import START, read_recording_csv
from slamgauge.compare.storage.interpolation import interpolated
from slamgauge.compare.storage.result_files import MAPPING
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import between, wrap
from slamgauge.sensors import SENSORS
from slamgauge.truth import Truth


def read_csv_log(path: Path, overrides: Sequence[str] = ()) -> Imported:
    """Read the recording of CSV files, its truth if there is one, and the mapping in force.

    Args:
        path: The folder, or a recording.toml with any name.
        overrides: `section.key=value`, on top of recording.toml.

    Returns:
        The log. A folder that slamgauge exported has no mapping.

    Raises:
        UserError: With the file, the line and the remedy.
    """
    if (path / START).exists() and not (path / MAPPING).exists():
        if overrides:
            raise UserError(f"{path}: {START} states everything; leave {overrides[0]} out, or remove that file")
        return Imported(read_recording_csv(path))
    mapping = _with_truth_beside(load_mapping(path, overrides))
    odometry, kind = _odometry(mapping)
    seen = _observations(mapping)
    landmark, kept, notes = identified(seen.values[:, 1].astype(np.int64))
    if seen.unused:
        notes = (*notes, f"{mapping.observations.file}: columns that are not used: {', '.join(seen.unused)}")
    notes += _zero_ranges(mapping, seen)
    if mapping.observations.drop_zero_ranges and SENSORS[seen.kind].has_range:
        is_range = seen.values[:, 2] > 0.0
        landmark = None if landmark is None else landmark[is_range[kept]]
        kept = kept & is_range
    with of_file(mapping.folder / mapping.observations.file):
        odometry, steps, inside, more = joined(odometry, seen.values[kept, 0])
    values, landmark = seen.values[kept][inside], None if landmark is None else landmark[inside]
    truth = _truth(mapping, odometry.stamps, landmark)
    sensor = SENSORS[seen.kind].name
    names = zip(SENSORS[sensor].columns, SENSORS[sensor].sigmas, strict=True)
    sigmas = [
        seen.sigmas[column][kept][inside] if column in seen.sigmas else np.full(len(values), mapping.sigma(name))
        for column, name in names
    ]
    with of_file(path):
        recording = Recording(
            stamps=odometry.stamps,
            prior_mean=_start(mapping, truth),
            prior_cov=np.diag(mapping.start.sigmas) ** 2,
            odometry=odometry.increments,
            odometry_cov=odometry.covs,
            sensor=sensor,
            observation_step=steps,
            observation=np.where(SENSORS[sensor].is_angle, wrap(values[:, 2:]), values[:, 2:]),
            observation_cov=diagonal_covariances(np.column_stack(sigmas)),
            landmark=landmark,
        )
    in_force = replace(
        mapping,
        odometry=replace(mapping.odometry, kind=cast("Any", kind)),
        observations=replace(mapping.observations, kind=sensor),
    )
    return Imported(recording, truth, (*notes, *more), in_force.sections(), int(np.sum(~inside)))


def _odometry(mapping: LogMapping) -> tuple[Odometry, str]:
    """Return the odometry at the stamps of the log, and the kind of its file."""
    section, noise = mapping.odometry, mapping.noise
    table = read_columns(mapping.folder / section.file, section, ODOMETRIES, "odometry", section.kind)
    looks_back = table.kind == "increments" or (table.kind == "velocities" and section.holds == "since-last")
    stamps, values = _from_the_start(mapping, table, looks_back=looks_back)
    seconds = np.diff(stamps)
    match table.kind:
        case "increments":
            increments = values[1:]
        case "velocities":
            increments = constant_twist(values[1:] if looks_back else values[:-1], seconds)
        case _:
            increments = between(values[:-1], values[1:])
    looks_ahead = table.kind == "velocities" and not looks_back
    require_turns(table.lines if looks_ahead else table.lines[-len(increments) :], increments)
    sigmas = np.array([mapping.sigma("forward"), mapping.sigma("lateral"), mapping.sigma("turn")])
    growth = {"step": np.ones_like(seconds), "second": np.sqrt(seconds), "speed": seconds}[noise.per]
    return Odometry(stamps, increments, diagonal_covariances(sigmas * growth[:, None])), table.kind


def _from_the_start(mapping: LogMapping, table: Rows, *, looks_back: bool) -> tuple[Float, Float]:
    """Return stamps (N+1,) and values (N+1, 3) of the rows; the first is the start.

    If rows describe the time before their stamp (`looks_back`), a row for `start.stamp` is added in front. Without
    `start.stamp` the first row is the start, and its values are not used.
    """
    stamps, values, start = table.values[:, 0], table.values[:, 1:], mapping.start.stamp
    require_order(table.lines, stamps, strict=True)
    if start is not None:
        if not looks_back:
            what = f"start.stamp: the log starts at the first row of {table.kind}"
            raise UserError(f"{mapping.where}: {what}; remove it")
        if len(stamps) and not start < stamps[0]:
            raise table.lines[0].refused(f"is not after the start at {start:.9g} s", "correct start.stamp")
        stamps, values = np.concatenate([[start], stamps]), np.concatenate([np.zeros((1, 3)), values])
    if len(stamps) < 2:
        raise UserError(f"{mapping.folder / mapping.odometry.file}: fewer than two stamps; give the whole log")
    return stamps, values


def _observations(mapping: LogMapping) -> Rows:
    """Return stamp, landmark and measured values of every observation."""
    section = mapping.observations
    table = read_columns(mapping.folder / section.file, section, tuple(SENSORS), "observations", section.kind)
    require_order(table.lines, table.values[:, 0], strict=False)
    if SENSORS[table.kind].has_range:
        require_ranges(table.lines, table.values[:, 2])
    if SENSORS[table.kind].has_bearing:
        require_bearings(table.lines, table.values[:, -1])
    return table


def _zero_ranges(mapping: LogMapping, seen: Rows) -> tuple[str, ...]:
    """Return a note about observations with range 0, which sensors write where they detect nothing."""
    if not SENSORS[seen.kind].has_range or seen.values[:, 2].all():
        return ()
    zero = np.flatnonzero(seen.values[:, 2] == 0.0)
    what = f"{len(zero)} observations have range 0 m (no detection?), the first in line {seen.lines[zero[0]].number}"
    if mapping.observations.drop_zero_ranges:
        return (f"{what}; they are left out",)
    return (f"warning: {what}; leave them out with --set observations.drop_zero_ranges=true",)


def _with_truth_beside(mapping: LogMapping) -> LogMapping:
    """Add the files of ground truth that are in the folder of the log and that the mapping does not name."""
    files = {"file": "truth.csv", "landmarks": "landmarks.csv"}
    found: dict[str, Any] = {key: name for key, name in files.items() if (mapping.folder / name).exists()}
    named: dict[str, Any] = {
        key: getattr(mapping.truth, key) for key in files if getattr(mapping.truth, key) is not None
    }
    return replace(mapping, truth=replace(mapping.truth, **{**found, **named}))


def _truth(mapping: LogMapping, stamps: Float, landmark: Int | None) -> Truth | None:
    """Return the ground truth at the stamps (N+1,): of the path, of the landmarks or of both; None without any."""
    section, folder = mapping.truth, mapping.folder
    if section.file is None and section.landmarks is None:
        return None
    poses = ids = landmarks = None
    if section.file is not None:
        table = read_columns(folder / section.file, section, ("poses",), "truth", "poses")
        require_order(table.lines, table.values[:, 0], strict=True)
        if not len(table.values):
            raise UserError(f"{folder / section.file}: has no rows; write some, or remove the file")
        poses = interpolated(table.values[:, 0], table.values[:, 1:], stamps, section.max_gap)
    if section.landmarks is not None:
        columns = replace(section, columns=section.landmark_columns)
        table = read_columns(folder / section.landmarks, columns, ("landmarks",), "truth", "landmarks")
        ids, landmarks = table.values[:, 0].astype(np.int64), table.values[:, 1:]
    with of_file(folder / (section.landmarks or section.file or "")):
        return Truth(poses=poses, landmark_ids=ids, landmarks=landmarks, association=landmark)


def _start(mapping: LogMapping, truth: Truth | None) -> Float:
    """Return the start pose (3,): as stated, else the true one, else the origin."""
    if mapping.start.pose is not None:
        return np.array(mapping.start.pose, dtype=np.float64)
    if truth is None or truth.poses is None:
        return np.zeros(3)
    if np.isnan(truth.poses[0]).any():
        what = "start.pose: the ground truth has no pose at the start"
        raise UserError(f"{mapping.where}: {what}; state it, or cut the log")
    return truth.poses[0]
