"""Settings for reading the CSV files of a robot's log, from `recording.toml` and `--set`.

    [odometry]      file, kind (increments, velocities, poses), holds, time, length, angle, columns
    [observations]  file, kind (range-bearing, bearing, position), time, length, angle, columns,
                    drop_zero_ranges
    [noise]         forward, lateral, turn, per (step, second, speed); range, bearing, position: [m, rad]
    [start]         file, stamp, pose, sigmas: [s], [m, m, rad]
    [truth]         file, landmarks, max_gap, time, length, angle, columns, landmark_columns
    [ids]           NAME = number of a landmark whose id in the files is a text

Every key has a default, except the noise, which the rows may have too. `columns` maps our columns to names in the file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from math import pi
from pathlib import Path
from typing import Any, Literal

from slamgauge.compare.datasets.settings import Id, Pose, Section, SensorSigma, Sigma, Text, load_settings
from slamgauge.compare.storage.result_files import MAPPING
from slamgauge.compare.storage.safe_names import shown
from slamgauge.errors import UserError
from slamgauge.sensors import Sensor

Columns = dict[Text, Text]
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "rad": 1.0, "deg": pi / 180}
BESIDE = {("start", "file"): "start.csv", ("truth", "file"): "truth.csv", ("truth", "landmarks"): "landmarks.csv"}
Motion = Literal["increments", "velocities", "poses"]


@dataclass(frozen=True)
class FileTable(Section):
    """Units of a file where its header has none, and the names of its columns."""

    time: Literal["s", "ms", "us", "ns"] = "s"
    length: Literal["m", "cm", "mm"] = "m"
    angle: Literal["rad", "deg"] = "rad"
    columns: Columns = field(default_factory=Columns)


@dataclass(frozen=True)
class OdometryTable(FileTable):
    """The file of odometry. A velocity is valid until the next row, or since the last one."""

    file: Text = "odometry.csv"
    kind: Motion | None = None
    holds: Literal["until-next", "since-last"] = "until-next"


@dataclass(frozen=True)
class ObservationsTable(FileTable):
    """The file of observations."""

    file: Text = "observations.csv"
    kind: Sensor | None = None
    drop_zero_ranges: bool = False


@dataclass(frozen=True)
class Noise(Section):
    """Standard deviations [m, rad] of a row of odometry, of a second of it, or of its speeds, and of the sensor."""

    forward: Sigma | None = None
    lateral: Sigma | None = 0.0
    turn: Sigma | None = None
    per: Literal["step", "second", "speed"] = "step"
    range: SensorSigma | None = None
    bearing: SensorSigma | None = None
    position: SensorSigma | None = None


@dataclass(frozen=True)
class StartPose(Section):
    """Pose [m, m, rad] (by default the true one) and standard deviations of the start."""

    pose: Pose | None = None
    sigmas: tuple[Sigma, Sigma, Sigma] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Start(StartPose):
    """The start of a log: its time [s] (by default that of the first row of odometry), or a file with a row of it."""

    stamp: float | None = None
    file: Text | None = None


@dataclass(frozen=True)
class TruthTable(FileTable):
    """The files of ground truth. Poses are not interpolated over gaps longer than `max_gap` [s]."""

    file: Text | None = None
    landmarks: Text | None = None
    max_gap: Sigma = 1.0
    landmark_columns: Columns = field(default_factory=Columns)


@dataclass(frozen=True)
class LogMapping(Section):
    """All sections."""

    odometry: OdometryTable = field(default_factory=OdometryTable)
    observations: ObservationsTable = field(default_factory=ObservationsTable)
    noise: Noise = field(default_factory=Noise)
    start: Start = field(default_factory=Start)
    truth: TruthTable = field(default_factory=TruthTable)
    ids: dict[str, Id] = field(default_factory=dict[str, Id])

    def sections(self) -> dict[str, dict[str, Any]]:
        """Return the sections that are not empty as tables, with absolute paths."""
        tables = {name: table for name, table in asdict(self).items() if table}
        for section, key in (("odometry", "file"), ("observations", "file"), *BESIDE):
            if tables[section][key] is not None:
                tables[section][key] = shown(str(Path(tables[section][key]).absolute()))
        return tables

    def sigma(self, name: str, file: str) -> float:
        """Return a standard deviation of [noise]; raise `UserError` if it is missing, and in the rows of the file."""
        value = getattr(self.noise, name)
        if value is None:
            remedy = f"give --set noise.{name}=SIGMA, or add it to {MAPPING}"
            raise UserError(f"{file}: its rows have no noise, and noise.{name} is missing; {remedy}")
        return value


def load_mapping(path: Path, overrides: Sequence[str] = ()) -> LogMapping:
    """Load the mapping of a log, with paths of files; files of a start and a truth are added if they are in the folder.

    Args:
        path: The folder of the log, with or without a recording.toml, or such a file with any name.
        overrides: `section.key=value`, on top of the file.

    Raises:
        UserError: the file cannot be read, or a key or a value in it is wrong.
    """
    if path.is_file() and path.suffix != ".toml":
        raise UserError(f"{path}: is neither a folder nor a .toml file; give the folder of the log's files")
    where = path / MAPPING if path.is_dir() else path
    mapping = load_settings(LogMapping, where if where.exists() or not path.is_dir() else None, overrides)
    folder = where.parent
    for (section, key), name in BESIDE.items():
        if getattr(getattr(mapping, section), key) is None and (folder / name).exists():
            mapping = _with_file(mapping, section, key, Path(name))
    for section, key in (("odometry", "file"), ("observations", "file"), *BESIDE):
        name = getattr(getattr(mapping, section), key)
        if name is not None:
            mapping = _with_file(mapping, section, key, folder / name)
    return mapping


def _with_file(mapping: LogMapping, section: str, key: str, path: Path) -> LogMapping:
    changes: dict[str, Any] = {section: replace(getattr(mapping, section), **{key: str(path)})}
    return replace(mapping, **changes)
