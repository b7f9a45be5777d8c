"""Odometry and observations in the CSV files of a robot's log, with the noise of their rows or of the settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.csv_columns import QUATERNION, STAMP, CsvTable
from slamgauge.compare.datasets.csv_mapping import LogMapping, Motion
from slamgauge.compare.datasets.imported_log import diagonal_covariances
from slamgauge.compare.datasets.row_checks import require_bearings, require_order, require_ranges
from slamgauge.compare.datasets.synchronisation import Odometry, constant_twist
from slamgauge.compare.storage.csv_folder import OBSERVED, POSE_COV
from slamgauge.compare.storage.text_lines import Line
from slamgauge.errors import UserError
from slamgauge.se2 import between, wrap
from slamgauge.sensors import SENSORS, Sensor

MOTIONS: dict[Motion, tuple[str, ...]] = {
    "increments": ("dx", "dy", "dtheta"),
    "velocities": ("v", "vy", "omega"),
    "poses": ("x", "y", "theta"),
}
Kind = TypeVar("Kind", Motion, Sensor)
OPTIONAL = ("dy", "vy")  # 0 if they are missing
SENSED = {model.name: model.columns for model in SENSORS.values()}


class Driven(NamedTuple):
    """Odometry, the lines (N,) of its increments, its kind, and whether its stamps are times of ISO 8601."""

    odometry: Odometry
    lines: Sequence[Line]
    kind: Motion
    has_times: bool


class Seen(NamedTuple):
    """Observations.

    Attributes:
        sensor: their kind.
        times: (M,) stamps [s], or steps of the odometry.
        has_steps: whether `times` are steps.
        has_times: whether they are times of ISO 8601.
        values: (M, d).
        covs: (M, d, d).
        ids: M whole numbers or texts; -1 without an id.
    """

    sensor: Sensor
    times: Float
    has_steps: bool
    has_times: bool
    values: Float
    covs: Float
    ids: list[int | str]


def read_odometry(mapping: LogMapping, notes: list[str]) -> Driven:
    """Read the odometry. Rows of increments describe the time before their stamp, and begin at `start.stamp` if stated.

    Args:
        mapping: The settings.
        notes: Notes about the file are added.

    Raises:
        UserError: the columns are missing, or a row is wrong; with its line.
    """
    section, start = mapping.odometry, mapping.start.stamp
    known = (*STAMP, *(name for names in MOTIONS.values() for name in names), *QUATERNION)
    table = CsvTable(Path(section.file), section, section.columns, known)
    kind = _kind(table, MOTIONS, section.kind, "odometry")
    stamps, has_times = table.stamps()
    require_order(table.rows, stamps, strict=True)
    values = table.poses() if kind == "poses" else _columns(table, MOTIONS[kind])
    sigmas = [None if kind == "poses" else table.sigmas(name) for name in MOTIONS[kind]]
    covs = table.covariances(POSE_COV) if kind == "increments" else None
    if table.has("step") and (table.steps() != np.arange(1, len(stamps) + 1)).any():
        raise table.header.refused("the steps are not 1, 2, 3, ...", "sort the rows, and number them from 1")
    note_unused(table, notes)
    looks_back = kind == "increments" or (kind == "velocities" and section.holds == "since-last")
    if start is not None and not looks_back:
        raise UserError(f"{section.file}: start.stamp: the log starts at the first row of {kind}; remove it")
    if start is not None and len(stamps) and not start < stamps[0]:
        raise table.rows[0].refused(f"is not after the start at {start:.9g} s", "correct start.stamp")
    stamps = stamps if start is None else np.concatenate([[start], stamps])
    if len(stamps) < 2:
        raise UserError(f"{section.file}: fewer than two stamps; give the whole log")
    steps, seconds = len(stamps) - 1, np.diff(stamps)
    rows = slice(steps) if kind == "velocities" and not looks_back else slice(len(values) - steps, None)
    if kind == "poses":
        increments = between(values[:-1], values[1:])
    else:
        increments = values[rows] if kind == "increments" else constant_twist(values[rows], seconds)
    of_rows = [None if each is None else each[rows] for each in sigmas]
    noise = _noise(mapping, kind, of_rows, seconds) if covs is None else covs[rows]
    return Driven(Odometry(stamps, increments, noise), table.rows[rows], kind, has_times)


def read_observations(mapping: LogMapping, notes: list[str]) -> Seen:
    """Read the observations; those of range 0 are dropped on request.

    Args:
        mapping: The settings.
        notes: Notes about the file are added.

    Raises:
        UserError: the columns are missing, or a row is wrong; with its line.
    """
    section = mapping.observations
    known = (*STAMP, "step", "landmark", *(name for names in SENSED.values() for name in names))
    table = CsvTable(Path(section.file), section, section.columns, known)
    sensor = _kind(table, SENSED, section.kind, "observations")
    model = SENSORS[sensor]
    has_steps = table.has("step") and not table.has("stamp")
    times, has_times = (table.steps(), False) if has_steps else table.stamps()
    require_order(table.rows, times, strict=False)
    values, ids = _columns(table, model.columns), table.ids()
    if model.has_range:
        require_ranges(table.rows, values[:, 0])
        notes += _zero_ranges(table.rows, values[:, 0], dropped=section.drop_zero_ranges)
    if model.has_bearing:
        require_bearings(table.rows, values[:, -1])
    if has_steps and 0 < ids.count(-1) < len(ids):
        raise table.rows[ids.index(-1)].refused("only some ids are -1", "write -1 in all rows, or ids from 0")
    covs = table.covariances(OBSERVED[sensor][model.dim :])
    if covs is None:
        stated = zip(map(table.sigmas, model.columns), model.sigmas, strict=True)
        of_all = np.ones(len(times))
        sigmas = [mapping.sigma(name, section.file) * of_all if each is None else each for each, name in stated]
        covs = diagonal_covariances(np.column_stack(sigmas))
    note_unused(table, notes)
    seen = Seen(sensor, times, has_steps, has_times, np.where(model.is_angle, wrap(values), values), covs, ids)
    if not (section.drop_zero_ranges and model.has_range):
        return seen
    kept = np.flatnonzero(values[:, 0] > 0.0)
    return seen._replace(
        times=times[kept], values=seen.values[kept], covs=covs[kept], ids=[ids[at] for at in kept.tolist()]
    )


def note_unused(table: CsvTable, notes: list[str]) -> None:
    """Add a note about the columns that nothing has read."""
    if table.unused:
        notes.append(f"{Path(table.header.path).name}: columns that are not used: {', '.join(table.unused)}")


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


def _noise(mapping: LogMapping, kind: str, of_rows: Sequence[Float | None], seconds: Float) -> Float:
    """Return covariances (N, 3, 3) from standard deviations of rows (of speeds if these are velocities) or settings."""
    growth = {"step": np.ones_like(seconds), "second": np.sqrt(seconds), "speed": seconds}
    of_row = growth["speed" if kind == "velocities" else "step"]
    stated = zip(of_rows, ("forward", "lateral", "turn"), strict=True)
    sigmas = [
        mapping.sigma(name, mapping.odometry.file) * growth[mapping.noise.per] if each is None else each * of_row
        for each, name in stated
    ]
    return diagonal_covariances(np.column_stack(sigmas))


def _zero_ranges(rows: Sequence[Line], ranges: Float, *, dropped: bool) -> list[str]:
    """Return a note about observations with range 0, which sensors write where they detect nothing."""
    zero = np.flatnonzero(ranges == 0.0)
    if not len(zero):
        return []
    what = f"{len(zero)} observations have range 0 m (no detection?), the first in line {rows[zero[0]].number}"
    if dropped:
        return [f"{what}; they are left out"]
    return [f"warning: {what}; leave them out with --set observations.drop_zero_ranges=true"]
