"""A robot's log in CSV files: odometry, observations and, if there is one, ground truth, each with its own stamps.

Noise is stated in the settings (`log_settings`) or in each row, by standard deviations (range_std) or by covariances,
as in a folder that slamgauge exported (`csv_folder`). Observations have stamps, or steps of the odometry. The robot
drives arcs: it keeps its speed and yaw rate between two rows.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets import imported_log as logs
from slamgauge.compare.datasets.csv_columns import CsvTable
from slamgauge.compare.datasets.log_settings import CsvMapping, Motion, Noise, load_settings
from slamgauge.compare.storage.csv_folder import OBSERVED, POSE_COV
from slamgauge.compare.storage.result_files import MAPPING, shown
from slamgauge.compare.storage.trajectories import Trajectory
from slamgauge.errors import UserError
from slamgauge.se2 import between, exp
from slamgauge.sensors import SENSORS, Sensor

MOTIONS: dict[Motion, tuple[str, ...]] = {
    "increments": ("dx", "dy", "dtheta"),
    "velocities": ("v", "vy", "omega"),
    "poses": ("x", "y", "theta"),
}
SENSED: dict[Sensor, tuple[str, ...]] = {model.name: model.columns for model in SENSORS.values()}
OPTIONAL = ("dy", "vy")  # 0 if they are missing
FILES = (  # sections and keys of files, and names that are read if they exist
    ("odometry", "file", "odometry.csv"),
    ("observations", "file", "observations.csv"),
    ("start", "file", "start.csv"),
    ("truth", "file", "truth.csv"),
    ("truth", "landmarks", "landmarks.csv"),
)
Kind = TypeVar("Kind", Motion, Sensor)


def read_csv_log(folder: Path, overrides: Sequence[str] = ()) -> logs.Imported:
    """Read the recording of CSV files, its truth if there is one, and the mapping in force.

    Args:
        folder: The folder, or a recording.toml with any name.
        overrides: `section.key=value`, on top of recording.toml.

    Raises:
        UserError: With the file, the line and the remedy.
    """
    notes: list[str] = []
    mapping, prior_cov = _with_start(_load(folder, overrides))
    odometry, clock = _read_odometry(mapping, notes)
    seen, has_steps = _read_observations(mapping, clock, notes)
    path, true_map = _truth(mapping, clock, notes)
    log = logs.Log(
        where=folder,
        odometry=odometry,
        seen=seen,
        has_steps=has_steps,
        start=mapping.start.pose,
        prior_cov=prior_cov,
        path=path,
        max_gap=mapping.truth.max_gap,
        map=true_map,
        notes=notes,
    )
    found = log.imported(mapping)
    tables = found.mapping or {}
    for section, key, _ in FILES:
        if tables[section][key] is not None:
            tables[section][key] = shown(str(Path(tables[section][key]).absolute()))
    return found


def _load(path: Path, overrides: Sequence[str]) -> CsvMapping:
    """Load the settings of a folder or of a TOML file, with the paths of all files that exist or are stated."""
    if path.is_file() and path.suffix != ".toml":
        raise UserError(f"{path}: is neither a folder nor a .toml file; give the folder of the log's files")
    where = path / MAPPING if path.is_dir() else path
    mapping = load_settings(CsvMapping, where if where.exists() or not path.is_dir() else None, overrides)
    for section, key, usual in FILES:
        table = getattr(mapping, section)
        name = getattr(table, key) or (usual if (where.parent / usual).exists() else None)
        if name is not None:
            stated = table.model_copy(update={key: str(where.parent / name)})
            mapping = mapping.model_copy(update={section: stated})
    return mapping


def _with_start(mapping: CsvMapping) -> tuple[CsvMapping, Float]:
    """Return the mapping with the time and pose of the start file where it states none, and the covariance (3, 3)."""
    start, cov = mapping.start, np.diag(mapping.start.sigmas) ** 2
    if start.file is None:
        return mapping, cov
    table = CsvTable(start.file, mapping.odometry, {})
    if len(table.rows) != 1:
        raise UserError(f"{start.file}: has {len(table.rows)} rows; write one, the prior of the start pose")
    covs, pose = table.covariances(POSE_COV), start.pose or tuple(table.poses()[0].tolist())
    stamp = float(table.stamps()[0]) if start.stamp is None else start.stamp
    stated = start.model_copy(update={"pose": pose, "stamp": stamp})
    return mapping.model_copy(update={"start": stated}), cov if covs is None or cov.any() else covs[0]


def _read_odometry(mapping: CsvMapping, notes: list[str]) -> tuple[logs.Odometry, float | None]:
    """Return the odometry, and its first stamp [s] if stamps are times of ISO 8601; add notes.

    Rows of increments describe the time before their stamp, and begin at `start.stamp` if that is stated.
    """
    section, start = mapping.odometry, mapping.start.stamp
    table = CsvTable(section.file, section, section.columns)
    kind = _kind(table, MOTIONS, section.kind, "odometry")
    stamps = table.stamps()
    logs.require_order(table.rows, stamps, strict=True)
    values = table.poses() if kind == "poses" else _columns(table, MOTIONS[kind])
    if table.has("step") and (table.numbers("step") != np.arange(1, len(stamps) + 1)).any():
        raise table.header.refused("the steps are not 1, 2, 3, ...", "sort the rows, and number them from 1")
    looks_back = kind == "increments" or (kind == "velocities" and section.holds == "since-last")
    if start is not None and not looks_back:
        raise UserError(f"{section.file}: start.stamp: the log starts at the first row of {kind}; remove it")
    if start is not None and len(stamps) and not start < stamps[0]:
        raise table.rows[0].refused(f"is not after the start at {logs.shown_stamp(start)} s", "correct start.stamp")
    stamps = stamps if start is None else np.append(start, stamps)
    if len(stamps) < 2:
        raise UserError(f"{section.file}: fewer than two stamps; give the whole log")
    steps, seconds = len(stamps) - 1, np.diff(stamps)
    rows = slice(len(values) - steps, None) if looks_back or kind == "poses" else slice(steps)
    increments = values[rows]
    if kind != "increments":
        increments = between(values[:-1], values[1:]) if kind == "poses" else exp(increments * seconds[:, None])
    lasts = np.ones(len(values))
    lasts[rows] = seconds
    named = zip(("", "", "") if kind == "poses" else MOTIONS[kind], ("forward", "lateral", "turn"), strict=True)
    triangle, of_row = POSE_COV if kind == "increments" else (), lasts if kind == "velocities" else 1.0
    covs = _covariances(table, mapping.noise, named, triangle, mapping.noise.growth(lasts), of_row)
    notes += table.unused()
    return logs.Odometry(stamps, increments, covs[rows], table.rows[rows]), stamps[0] if table.has_times else None


def _read_observations(mapping: CsvMapping, clock: float | None, notes: list[str]) -> tuple[logs.Observed, bool]:
    """Return the observations, without those of range 0 on request, and whether their times are steps; add notes."""
    section = mapping.observations
    table = CsvTable(section.file, section, section.columns)
    sensor = _kind(table, SENSED, section.kind, "observations")
    model = SENSORS[sensor]
    has_steps = table.has("step") and not table.has("stamp")
    times = table.numbers("step") if has_steps else table.stamps()
    logs.require_order(table.rows, times, strict=False)
    times = times if has_steps else _on_clock(clock, table, times, notes)
    values, ids = logs.checked(sensor, table.rows, _columns(table, model.columns)), table.ids()
    named = zip(model.columns, model.sigmas, strict=True)
    covs = _covariances(table, mapping.noise, named, OBSERVED[sensor][model.dim :])
    notes += table.unused()
    zero = (values[:, 0] == 0.0) & model.has_range
    if zero.any():
        line = table.rows[int(np.argmax(zero))].number
        what = f"{zero.sum()} observations have range 0 m (no detection?), the first in line {line}"
        remedy = "leave them out with --set observations.drop_zero_ranges=true"
        notes.append(f"{what}; they are left out" if section.drop_zero_ranges else f"warning: {what}; {remedy}")
    kept = np.flatnonzero(~(zero & section.drop_zero_ranges))
    return logs.Observed(sensor, times[kept], [ids[at] for at in kept.tolist()], values[kept], covs[kept]), has_steps


def _on_clock(clock: float | None, table: CsvTable, times: Float, notes: list[str]) -> Float:
    """Return stamps (n,) on the odometry's clock: seconds count from its first row if that has a time of day."""
    if clock is None or table.has_times or not len(times) or times.max() >= clock:
        return times
    notes.append(f"{table.path.name}: stamps are seconds, those of the odometry times: they count from its first row")
    return times + clock


def _truth(mapping: CsvMapping, clock: float | None, notes: list[str]) -> tuple[Trajectory | None, logs.TrueMap | None]:
    """Return the true path and the true map, if the log has them; add notes."""
    section, path, true_map = mapping.truth, None, None
    if section.file is not None:
        table = CsvTable(section.file, section, section.columns)
        times, poses = table.stamps(), table.poses()
        logs.require_order(table.rows, times, strict=True)
        path = Trajectory(section.file, _on_clock(clock, table, times, notes), poses)
        notes += table.unused()
    if section.landmarks is not None:
        table = CsvTable(section.landmarks, section, section.landmark_columns)
        true_map = table.path, table.ids(), _columns(table, ("x", "y"))
        notes += table.unused()
    return path, true_map


def _kind(table: CsvTable, kinds: Mapping[Kind, Sequence[str]], stated: Kind | None, section: str) -> Kind:
    """Return the kind of a file: the stated one, or the one whose columns it has."""
    needed = {kind: {name for name in names if name not in OPTIONAL} for kind, names in kinds.items()}
    found = [kind for kind, names in needed.items() if stated in (None, kind) and table.has(*names)]
    found = [kind for kind in found if not any(needed[kind] < needed[other] for other in found)]
    if len(found) == 1:
        return found[0]
    if found:
        raise table.header.refused(f"could be {' or '.join(found)}", f"give the kind with {section}.kind")
    if section == "observations" and table.has("range"):
        raise table.header.refused("ranges without bearings", "range-only landmarks are not supported; add bearings")
    forms = " or ".join(",".join(kinds[kind]) for kind in kinds if stated in (None, kind))
    raise table.header.refused(f"does not have the columns {forms}", f"name its own in {section}.columns")


def _columns(table: CsvTable, names: Sequence[str]) -> Float:
    """Return the values (n, k) of columns."""
    return np.column_stack([table.numbers(name, 0.0 if name in OPTIONAL else None) for name in names])


def _covariances(
    table: CsvTable,
    noise: Noise,
    named: Iterable[tuple[str, str]],
    triangle: Sequence[str],
    growth: Float | float = 1.0,
    of_row: Float | float = 1.0,
) -> Float:
    """Return covariances (n, d, d): those of rows, else of the stated noise; `named` are columns and names of it.

    `triangle` are columns of covariances. `growth` and `of_row` are factors (n,) of stated sigmas and of those of rows.
    """
    covs = table.covariances(triangle) if triangle else None
    if covs is not None:
        return covs
    sigmas = list[Float | float]()
    for column, name in named:
        of_rows, stated = table.sigmas(column), getattr(noise, name)
        if of_rows is None and stated is None:
            remedy = f"give --set noise.{name}=SIGMA, or add it to {MAPPING}"
            raise UserError(f"{table.path}: its rows have no noise, and noise.{name} is missing; {remedy}")
        sigmas.append(stated * growth if of_rows is None else of_rows * of_row)
    return logs.with_sigmas(np.zeros((len(table.rows), len(sigmas), len(sigmas))), sigmas)
