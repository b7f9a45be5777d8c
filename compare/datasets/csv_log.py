"""A robot's log in CSV files: odometry, observations, and ground truth if there is any, each with stamps of its own.

`mapping` says how the files are to be read. A folder that slamgauge has exported, or that has the files of
`csv_folder`, is read as it is. Otherwise the noise is not in the files and must be stated. The robot drives arcs: it
keeps its speed and yaw rate between two rows. Observations are put on the odometry as `timeline` says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.datasets.csv_columns import Source, Table, read_columns, require_known
from slamgauge.compare.datasets.csv_mapping import LogMapping, ObservationsTable, OdometryTable, load_mapping
from slamgauge.compare.datasets.imported_log import Imported, diagonal_covariances, identified, of_file
from slamgauge.compare.datasets.synchronisation import (
    Odometry,
    constant_twist,
    interpolated,
    joined,
    require_turns,
)
from slamgauge.compare.datasets.text_lines import require_order, require_ranges
from slamgauge.compare.storage.csv_folder import START, read_recording_csv
from slamgauge.compare.storage.result_files import MAPPING
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import between, wrap
from slamgauge.sensors import SENSORS, Sensor
from slamgauge.truth import Truth

ODOMETRIES = ("increments", "velocities", "poses")

Sections = dict[str, dict[str, Any]]


def read_csv_log(path: Path, overrides: Sequence[str] = ()) -> tuple[Imported, Sections | None]:
    """The recording of CSV files, its truth if there is any, and the mapping by which it was read.

    Args:
        path: The folder, or a recording.toml of any name.
        overrides: `section.key=value`, on top of recording.toml.

    Returns:
        What was read; the mapping is None for a folder that slamgauge has exported.

    Raises:
        UserError: With the file, the line and the remedy.
    """
    if (path / START).exists() and not (path / MAPPING).exists():
        if overrides:
            raise UserError(f"{path}: all is said by its {START}; leave {overrides[0]} away, or remove that file")
        return Imported(read_recording_csv(path), None, ()), None
    mapping = _with_truth_beside(load_mapping(path, overrides))
    odometry, kind = _odometry(mapping)
    seen = _observations(mapping)
    landmark, kept, notes = identified(seen.values[:, 1].astype(np.int64))
    odometry, steps, inside, more = joined(odometry, seen.values[kept, 0])
    values, landmark = seen.values[kept][inside], None if landmark is None else landmark[inside]
    truth = _truth(mapping, odometry.stamps, landmark)
    sensor = SENSORS[seen.kind].name
    sigmas = [mapping.sigma(name) for name in SENSORS[sensor].sigmas]
    with of_file(path):
        recording = Recording(
            stamps=odometry.stamps,
            prior_mean=_start(mapping, truth),
            prior_cov=np.diag(mapping.start.sigmas) ** 2,
            odometry=odometry.increments,
            odometry_cov=odometry.covs,
            sensor=sensor,
            observation_step=steps,
            observation=_wrapped(values[:, 2:], sensor),
            observation_cov=diagonal_covariances(np.tile(sigmas, (len(values), 1))),
            landmark=landmark,
        )
    in_force = replace(
        mapping,
        odometry=replace(mapping.odometry, kind=kind),
        observations=replace(mapping.observations, kind=sensor),
    )
    return Imported(recording, truth, (*notes, *more)), in_force.sections()


def _odometry(mapping: LogMapping) -> tuple[Odometry, str]:
    """The odometry as the log has it, and the kind of its file."""
    section = mapping.odometry
    require_known(section.columns, ODOMETRIES, f"{mapping.where}: odometry.columns")
    table = read_columns(_source(mapping, section), ODOMETRIES, "odometry", section.kind)
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
    ahead = table.kind == "velocities" and not looks_back
    require_turns(table.lines if ahead else table.lines[-len(increments) :], increments)
    noise = mapping.noise
    sigmas = np.array([mapping.sigma("forward"), noise.lateral, mapping.sigma("turn")])
    growth = {"step": np.ones_like(seconds), "second": np.sqrt(seconds), "speed": seconds}[noise.per]
    return Odometry(stamps, increments, diagonal_covariances(sigmas * growth[:, None])), table.kind


def _from_the_start(mapping: LogMapping, table: Table, *, looks_back: bool) -> tuple[Float, Float]:
    """Stamps (N+1,) and values (N+1, 3) of the rows, the first at the start.

    Rows that tell of the time before them have one more in front if the time of the start is known; else the first of
    them is the start, and what it tells is before it.
    """
    stamps, values, start = table.values[:, 0], table.values[:, 1:], mapping.start.stamp
    require_order(table.lines, stamps, strict=True)
    if start is not None:
        if not looks_back:
            what = f"start.stamp: rows of {table.kind} say themselves when the log starts"
            raise UserError(f"{mapping.where}: {what}; remove it")
        if len(stamps) and not start < stamps[0]:
            raise table.lines[0].refused(f"is not after the start at {start:.9g} s", "correct start.stamp")
        stamps, values = np.concatenate([[start], stamps]), np.concatenate([np.zeros((1, 3)), values])
    if len(stamps) < 2:
        raise UserError(f"{mapping.folder / mapping.odometry.file}: fewer than two moments; give the whole log")
    return stamps, values


def _observations(mapping: LogMapping) -> Table:
    """Stamp, landmark and what was measured of every observation."""
    section = mapping.observations
    require_known(section.columns, tuple(SENSORS), f"{mapping.where}: observations.columns")
    table = read_columns(_source(mapping, section), tuple(SENSORS), "observations", section.kind)
    require_order(table.lines, table.values[:, 0], strict=False)
    if SENSORS[table.kind].has_range:
        require_ranges(table.lines, table.values[:, 2])
    return table


def _wrapped(values: Float, sensor: Sensor) -> Float:
    """Return observations (M, d), their angles in (-pi, pi]."""
    return np.where(SENSORS[sensor].is_angle, wrap(values), values)


def _source(mapping: LogMapping, section: OdometryTable | ObservationsTable) -> Source:
    return Source(mapping.folder / section.file, section.columns, section.units)


# --- truth and start ---------------------------------------------------------------------------


def _with_truth_beside(mapping: LogMapping) -> LogMapping:
    """The mapping with the files of ground truth that lie beside the log and are not named."""
    beside = {"file": "truth.csv", "landmarks": "landmarks.csv"}
    there = {key: name for key, name in beside.items() if (mapping.folder / name).exists()}
    named = {key: getattr(mapping.truth, key) for key in beside if getattr(mapping.truth, key) is not None}
    return replace(mapping, truth=replace(mapping.truth, **(there | named)))


def _truth(mapping: LogMapping, stamps: Float, landmark: Int | None) -> Truth | None:
    """The ground truth at the stamps (N+1,), as far as there is any."""
    section = mapping.truth
    if section.file is None and section.landmarks is None:
        return None
    poses = ids = landmarks = None
    if section.file is not None:
        paths = mapping.folder / section.file
        require_known(section.columns, ("poses",), f"{mapping.where}: truth.columns")
        table = read_columns(Source(paths, section.columns, section.units), ("poses",), "truth", "poses")
        require_order(table.lines, table.values[:, 0], strict=True)
        if not len(table.values):
            raise UserError(f"{paths}: has no rows; write some, or remove the file")
        poses = interpolated(table.values[:, 0], table.values[:, 1:], stamps, section.max_gap)
    if section.landmarks is not None:
        map_paths = mapping.folder / section.landmarks
        require_known(section.landmark_columns, ("landmarks",), f"{mapping.where}: truth.landmark_columns")
        table = read_columns(
            Source(map_paths, section.landmark_columns, section.units), ("landmarks",), "truth", "landmarks"
        )
        ids, landmarks = table.values[:, 0].astype(np.int64), table.values[:, 1:]
    with of_file(mapping.folder / (section.landmarks or section.file or "")):
        return Truth(poses=poses, landmark_ids=ids, landmarks=landmarks, association=landmark)


def _start(mapping: LogMapping, truth: Truth | None) -> Float:
    """The pose (3,) at which the recording starts: as stated, else the true one, else the origin."""
    if mapping.start.pose is not None:
        return np.array(mapping.start.pose, dtype=np.float64)
    if truth is None or truth.poses is None:
        return np.zeros(3)
    if np.isnan(truth.poses[0]).any():
        raise UserError(
            f"{mapping.where}: start.pose: the ground truth has no pose at the start; state it, or cut the log"
        )
    return truth.poses[0]
