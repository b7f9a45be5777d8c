"""Settings for reading the CSV files of a robot's log, from `recording.toml` and `--set`.

    [odometry]      file, kind (increments, velocities, poses), holds, time, length, angle, columns
    [observations]  file, kind (range-bearing, bearing, position), time, length, angle, columns,
                    drop_zero_ranges
    [noise]         forward, lateral, turn, per (step, second, speed); range, bearing, position: [m, rad]
    [start]         stamp, pose, sigmas: [s], [m, m, rad]
    [truth]         file, landmarks, max_gap, time, length, angle, columns, landmark_columns

Every key has a default, except the noise. `columns` maps our columns to the names in the file, or to numbers from 1 if
it has no header.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from math import pi
from pathlib import Path
from types import NoneType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from slamgauge.compare.storage.result_files import MAPPING
from slamgauge.compare.storage.safe_names import shown
from slamgauge.compare.storage.toml_tables import Table, override, read_toml
from slamgauge.ekf.setting_rules import is_number
from slamgauge.errors import UserError
from slamgauge.sensors import SENSORS, Sensor
from slamgauge.suggestions import did_you_mean
from slamgauge.validation import LARGEST

Columns = dict[str, str | int]
Paths = str | list[str]  # paths into a ROS message: one, or several
LONGEST = 100  # characters of an unknown name in messages
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "rad": 1.0, "deg": pi / 180}
ODOMETRIES = ("increments", "velocities", "poses")
KINDS: dict[str, tuple[str, ...]] = {  # columns of each kind of file
    "increments": ("stamp", "dx", "dy", "dtheta"),
    "velocities": ("stamp", "v", "vy", "omega"),
    "poses": ("stamp", "x", "y", "theta"),
    **{name: ("stamp", "landmark", *model.columns) for name, model in SENSORS.items()},
    "landmarks": ("landmark", "x", "y"),
}
KINDS_OF: dict[tuple[str, str], tuple[str, ...]] = {  # kinds of a file, by section and key that map its columns
    ("odometry", "columns"): ODOMETRIES,
    ("observations", "columns"): tuple(SENSORS),
    ("truth", "columns"): ("poses",),
    ("truth", "landmark_columns"): ("landmarks",),
}


@dataclass(frozen=True)
class FileTable:
    """Units of a file, and its names or numbers of columns."""

    time: Literal["s", "ms", "us", "ns"] = "s"
    length: Literal["m", "cm", "mm"] = "m"
    angle: Literal["rad", "deg"] = "rad"
    columns: Columns = field(default_factory=Columns)


@dataclass(frozen=True)
class OdometryTable(FileTable):
    """The file of odometry. A velocity is valid until the next row, or since the last one."""

    file: str = "odometry.csv"
    kind: Literal["increments", "velocities", "poses"] | None = None
    holds: Literal["until-next", "since-last"] = "until-next"


@dataclass(frozen=True)
class ObservationsTable(FileTable):
    """The file of observations."""

    file: str = "observations.csv"
    kind: Sensor | None = None
    drop_zero_ranges: bool = False


@dataclass(frozen=True)
class Noise:
    """Standard deviations [m, rad] of a row of odometry, of a second of it, or of its speeds, and of the sensor."""

    forward: float | None = None
    lateral: float | None = 0.0
    turn: float | None = None
    per: Literal["step", "second", "speed"] = "step"
    range: float | None = None
    bearing: float | None = None
    position: float | None = None


@dataclass(frozen=True)
class StartPose:
    """Pose [m, m, rad] (by default the true one) and standard deviations of the start."""

    pose: tuple[float, float, float] | None = None
    sigmas: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Start(StartPose):
    """The start of a log, with its time [s] (by default that of the first row of odometry)."""

    stamp: float | None = None


@dataclass(frozen=True)
class TruthTable(FileTable):
    """The files of ground truth. Poses are not interpolated over gaps longer than `max_gap` [s]."""

    file: str | None = None
    landmarks: str | None = None
    max_gap: float = 1.0
    landmark_columns: Columns = field(default_factory=Columns)


@dataclass(frozen=True)
class LogMapping:
    """All sections, the folder that file names are relative to, and the file of the sections (for messages)."""

    folder: Path
    where: str
    odometry: OdometryTable
    observations: ObservationsTable
    noise: Noise
    start: Start
    truth: TruthTable

    def sections(self) -> dict[str, dict[str, Any]]:
        """Return the sections as tables, with absolute paths; bytes of names that are not UTF-8 are escaped."""
        tables = {name: asdict(getattr(self, name)) for name in SECTIONS}
        for table in tables.values():
            for key in ("file", "landmarks"):
                if table.get(key) is not None:
                    table[key] = shown(str((self.folder / table[key]).absolute()))
        return tables

    def sigma(self, name: str) -> float:
        """Return a standard deviation of [noise]; raise `UserError` if it is missing."""
        value = getattr(self.noise, name)
        if value is None:
            raise UserError(f"{self.where}: noise.{name}: missing; add it, or give --set noise.{name}=SIGMA")
        return value


SECTIONS = {name: kind for name, kind in get_type_hints(LogMapping).items() if name not in ("folder", "where")}
Section = TypeVar("Section")


def load_mapping(path: Path, overrides: Sequence[str] = ()) -> LogMapping:
    """Load the mapping of a log.

    Args:
        path: The folder of the log, with or without a recording.toml, or such a file with any name.
        overrides: `section.key=value`, on top of the file.

    Raises:
        UserError: the file cannot be read, or a key or a value in it is wrong.
    """
    if path.is_file() and path.suffix != ".toml":
        raise UserError(f"{path}: is neither a folder nor a .toml file; give the folder of the log's files")
    file = path / MAPPING if path.is_dir() else path
    table: Table = read_toml(file) if file.exists() or not path.is_dir() else {}
    for text in overrides:
        override(table, text)
    mapping = LogMapping(file.parent, str(file), **sections_of(table, SECTIONS, str(file)))
    _require_values(mapping)
    return mapping


def sections_of(table: Table, kinds: Mapping[str, type], where: str) -> dict[str, Any]:
    """Make the sections of a mapping from tables; refuse unknown sections and keys, and values of other types."""
    for name, section in table.items():
        if name not in kinds:
            raise UserError(f"{where}: {name[:LONGEST]}: unknown section; {did_you_mean(name, kinds)}")
        if not isinstance(section, dict):
            raise UserError(f"{where}: {name}: must be a section; write [{name}]")
    return {name: _section(kind, table.get(name, {}), f"{where}: {name}") for name, kind in kinds.items()}


def _section(kind: type[Section], table: Mapping[str, Any], where: str) -> Section:
    """Make a section of its table; refuse unknown keys and values that do not fit the type of their field."""
    hints = get_type_hints(kind)
    for key, value in table.items():
        if key not in hints:
            names = [each.name for each in fields(kind)]  # pyrefly: ignore[bad-argument-type]
            raise UserError(f"{where}.{key[:LONGEST]}: unknown key; {did_you_mean(key, names)}")
        fits, expected = _fits(value, hints[key])
        if not fits:
            raise UserError(f"{where}.{key}: must be {expected}, not {str(value)[:40]!r}; correct it")
    return kind(**table)


def _fits(value: object, hint: Any) -> tuple[bool, str]:
    """Return whether a value of a TOML file has the type of a field, and a description of the type."""
    if hint == Paths | None:
        texts = value if isinstance(value, list) else [value]
        return texts != [] and all(map(_is_text, texts)), "a text or a list of texts"
    hint = next((each for each in get_args(hint) if each is not NoneType), hint) if NoneType in get_args(hint) else hint
    if get_origin(hint) is Literal:
        return value in get_args(hint), f"one of {', '.join(get_args(hint))}"
    if hint is bool:
        return isinstance(value, bool), "true or false"
    if hint is float:
        return is_finite(value), "a number"
    if hint is str:
        return _is_text(value), "a text"
    if get_origin(hint) is tuple:
        return isinstance(value, list) and len(value) == 3 and all(map(is_finite, value)), "three numbers"
    is_mapping = isinstance(value, dict) and all(type(each) in (str, int) for each in value.values())
    return is_mapping, "a table of columns' names or numbers"


def _is_text(value: object) -> bool:
    return isinstance(value, str) and value != ""


def is_finite(value: Any) -> bool:
    """Return whether a value of a TOML file is a number that is not too large; NaN, True and False are not."""
    return is_number(value) and abs(value) < LARGEST


def _require_values(mapping: LogMapping) -> None:
    """Refuse negative standard deviations and gaps, sensor noise of 0, and columns that do not exist."""
    for key, value in asdict(mapping.noise).items():
        of_sensor = key in ("range", "bearing", "position")
        if isinstance(value, float | int) and (value < 0.0 or (of_sensor and value == 0.0)):
            raise UserError(f"{mapping.where}: noise.{key}: {value:g} is not a standard deviation; give one > 0")
    if min(mapping.start.sigmas) < 0.0:
        raise UserError(f"{mapping.where}: start.sigmas: must not be negative; correct them")
    if mapping.truth.max_gap < 0.0:
        raise UserError(f"{mapping.where}: truth.max_gap: {mapping.truth.max_gap:g} s; give seconds >= 0")
    for (section, key), kinds in KINDS_OF.items():
        known = list(dict.fromkeys(name for kind in kinds for name in KINDS[kind]))
        for name in getattr(getattr(mapping, section), key):
            if name not in known:
                where = f"{mapping.where}: {section}.{key}.{name}"
                raise UserError(f"{where}: unknown column; {did_you_mean(name, known)}")
