"""A robot's log in CSV files: odometry, observations and, if there is one, ground truth, each with its own stamps.

`csv_mapping` has the settings for reading the files. Noise is stated there or in each row, by standard deviations
(range_std) or by covariances, as in a folder that slamgauge exported (`csv_folder`). Observations have stamps, or steps
of the odometry. The robot drives arcs: it keeps its speed and yaw rate between two rows. `synchronisation` splits steps
at observations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.csv_columns import QUATERNION, STAMP, CsvTable
from slamgauge.compare.datasets.csv_mapping import LogMapping, load_mapping
from slamgauge.compare.datasets.csv_rows import Driven, note_unused, read_observations, read_odometry
from slamgauge.compare.datasets.imported_log import Imported, identified, numbered, of_file, start_pose
from slamgauge.compare.datasets.row_checks import require_order, require_turns
from slamgauge.compare.datasets.synchronisation import joined
from slamgauge.compare.storage.csv_folder import POSE_COV
from slamgauge.compare.storage.trajectories import interpolated
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.truth import Truth

POSE = ("x", "y", "theta", *QUATERNION)


def read_csv_log(path: Path, overrides: Sequence[str] = ()) -> Imported:
    """Read the recording of CSV files, its truth if there is one, and the mapping in force.

    Args:
        path: The folder, or a recording.toml with any name.
        overrides: `section.key=value`, on top of recording.toml.

    Raises:
        UserError: With the file, the line and the remedy.
    """
    notes: list[str] = []
    mapping, prior_cov = _with_start(load_mapping(path, overrides))
    driven, seen = read_odometry(mapping, notes), read_observations(mapping, notes)
    names, places = _true_map(mapping, notes)
    numbers, texts = numbered([*seen.ids, *names], mapping.ids, mapping.observations.file)
    if texts:
        notes.append(f"ids are texts, numbered from {min(texts.values())}: {', '.join(texts)}"[:200])
    landmark, kept, more = identified(numbers[: len(seen.ids)])
    odometry, times = driven.odometry, seen.times[kept]
    if seen.has_steps:
        steps, inside = times.astype(np.int64), np.ones(len(times), dtype=bool)
    else:
        require_turns(driven.lines, odometry.increments)
        with of_file(mapping.observations.file):
            times = _on_clock(mapping.observations.file, times, seen.has_times, driven, notes)
            odometry, steps, inside, outside = joined(odometry, times)
        more = (*more, *outside)
    landmark = None if landmark is None else landmark[inside]
    poses = _true_path(mapping, driven, odometry.stamps, notes)
    truth = None
    if poses is not None or places is not None:
        with of_file(mapping.truth.landmarks or mapping.truth.file or ""):
            true_ids = None if places is None else numbers[len(seen.ids) :]
            truth = Truth(poses=poses, landmark_ids=true_ids, landmarks=places, association=landmark)
    with of_file(path):
        start, of_start = start_pose(mapping.start.pose, poses, odometry.increments)
        recording = Recording(
            stamps=odometry.stamps,
            prior_mean=start,
            prior_cov=prior_cov,
            odometry=odometry.increments,
            odometry_cov=odometry.covs,
            sensor=seen.sensor,
            observation_step=steps,
            observation=seen.values[kept][inside],
            observation_cov=seen.covs[kept][inside],
            landmark=landmark,
        )
    in_force = replace(
        mapping,
        odometry=replace(mapping.odometry, kind=driven.kind),
        observations=replace(mapping.observations, kind=seen.sensor),
        ids=texts,
    )
    return Imported(recording, truth, (*notes, *more, *of_start), in_force.sections(), int(np.sum(~inside)))


def _with_start(mapping: LogMapping) -> tuple[LogMapping, Float]:
    """Return the mapping with the time and pose of the start file where it states none, and the covariance (3, 3)."""
    start, cov = mapping.start, np.diag(mapping.start.sigmas) ** 2
    if start.file is None:
        return mapping, cov
    table = CsvTable(Path(start.file), mapping.odometry, {}, ())
    if len(table.rows) != 1:
        raise UserError(f"{start.file}: has {len(table.rows)} rows; write one, the prior of the start pose")
    covs, (x, y, heading) = table.covariances(POSE_COV), table.poses()[0].tolist()
    stamp = float(table.stamps()[0][0]) if start.stamp is None else start.stamp
    stated = replace(start, pose=start.pose or (x, y, heading), stamp=stamp)
    return replace(mapping, start=stated), cov if covs is None or cov.any() else covs[0]


def _on_clock(file: str, times: Float, has_times: bool, driven: Driven, notes: list[str]) -> Float:
    """Return stamps (n,) on the odometry's clock: seconds count from its first row if that has a time of day."""
    first = driven.odometry.stamps[0]
    if not driven.has_times or has_times or not len(times) or times.max() >= first:
        return times
    notes.append(f"{Path(file).name}: stamps are seconds, those of the odometry times: they count from its first row")
    return times + first


def _true_path(mapping: LogMapping, driven: Driven, stamps: Float, notes: list[str]) -> Float | None:
    """Return the true poses (N+1, 3) at stamps; headings are NaN if the file has none."""
    section = mapping.truth
    if section.file is None:
        return None
    table = CsvTable(Path(section.file), section, section.columns, (*STAMP, *POSE))
    times, has_times = table.stamps()
    require_order(table.rows, times, strict=True)
    poses = table.poses()
    note_unused(table, notes)
    if not len(poses):
        raise UserError(f"{section.file}: has no rows; write some, or remove the file")
    return interpolated(_on_clock(section.file, times, has_times, driven, notes), poses, stamps, section.max_gap)


def _true_map(mapping: LogMapping, notes: list[str]) -> tuple[list[int | str], Float | None]:
    """Return the ids of the true landmarks, and their places (L, 2); None without a file."""
    section = mapping.truth
    if section.landmarks is None:
        return [], None
    table = CsvTable(Path(section.landmarks), section, section.landmark_columns, ("landmark", "x", "y"))
    places = np.column_stack([table.numbers("x"), table.numbers("y")])
    ids = table.ids()
    note_unused(table, notes)
    return ids, places
