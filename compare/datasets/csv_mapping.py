"""How the CSV files of a robot's log are to be read: what `recording.toml` and `--set` say.

    [odometry]      file, kind (increments, velocities, poses), holds, time, length, angle, columns
    [observations]  file, kind (range-bearing, bearing, position), time, length, angle, columns
    [noise]         forward, lateral, turn, per (step, second, speed); range, bearing, position: [m, rad]
    [start]         stamp, pose, sigmas: [s], [m, m, rad]
    [truth]         file, landmarks, max_gap, time, length, angle, columns, landmark_columns

Every key has a default but the noise. `columns` gives the file's own names, or numbers from 1 where it has no header.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from types import NoneType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from slamgauge.compare.storage.result_files import MAPPING
from slamgauge.compare.storage.toml_tables import Table, override, read_toml
from slamgauge.errors import UserError
from slamgauge.sensors import Sensor
from slamgauge.suggestions import did_you_mean
from slamgauge.validation import LARGEST

Columns = dict[str, str | int]
Time = Literal["s", "ms", "us", "ns"]
Length = Literal["m", "cm", "mm"]
Angle = Literal["rad", "deg"]
LONGEST = 100  # characters of an unknown name that are told
UNITS = {
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "ns": 1e-9,
    "m": 1.0,
    "cm": 1e-2,
    "mm": 1e-3,
    "rad": 1.0,
    "deg": math.pi / 180,
}


@dataclass(frozen=True)
class FileTable:
    """What may be said of any file: its units, and its own names or numbers of columns."""

    time: Time = "s"
    length: Length = "m"
    angle: Angle = "rad"
    columns: Columns = field(default_factory=Columns)

    @property
    def units(self) -> dict[str, str]:
        """Of times, lengths and angles."""
        return {"time": self.time, "length": self.length, "angle": self.angle}


@dataclass(frozen=True)
class OdometryTable(FileTable):
    """The file of odometry. A velocity holds until the next row, or since the last one."""

    file: str = "odometry.csv"
    kind: Literal["increments", "velocities", "poses"] | None = None
    holds: Literal["until-next", "since-last"] = "until-next"


@dataclass(frozen=True)
class ObservationsTable(FileTable):
    """The file of observations."""

    file: str = "observations.csv"
    kind: Sensor | None = None


@dataclass(frozen=True)
class Noise:
    """Standard deviations [m, rad]: of a row of odometry, of a second of it, or of speeds (by s); of the sensor."""

    forward: float | None = None
    lateral: float = 0.0
    turn: float | None = None
    per: Literal["step", "second", "speed"] = "step"
    range: float | None = None
    bearing: float | None = None
    position: float | None = None


@dataclass(frozen=True)
class Start:
    """What is known of the start: its time [s], its pose [m, m, rad], by default the truth's, and its sigmas."""

    stamp: float | None = None
    pose: tuple[float, float, float] | None = None
    sigmas: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class TruthTable(FileTable):
    """The files of ground truth; read if they are there, and if named they must be. Gaps [s] longer than that stay."""

    file: str | None = None
    landmarks: str | None = None
    max_gap: float = 1.0
    landmark_columns: Columns = field(default_factory=Columns)


@dataclass(frozen=True)
class LogMapping:
    """All of it, and the folder from which its files' names count."""

    folder: Path
    where: str
    odometry: OdometryTable
    observations: ObservationsTable
    noise: Noise
    start: Start
    truth: TruthTable

    def sections(self) -> dict[str, dict[str, Any]]:
        """Its sections as tables, with the files' full names."""
        tables = {name: asdict(getattr(self, name)) for name in SECTIONS}
        for table in tables.values():
            for key in ("file", "landmarks"):
                if table.get(key) is not None:
                    table[key] = str((self.folder / table[key]).absolute())
        return tables

    def sigma(self, name: str) -> float:
        """A standard deviation of [noise] that is needed and has no default."""
        value = getattr(self.noise, name)
        if value is None:
            raise UserError(f"{self.where}: noise.{name}: missing; add it, or give --set noise.{name}=SIGMA")
        return value


SECTIONS: dict[str, type[Any]] = {
    "odometry": OdometryTable,
    "observations": ObservationsTable,
    "noise": Noise,
    "start": Start,
    "truth": TruthTable,
}
Section = TypeVar("Section")


def load_mapping(path: Path, overrides: Sequence[str] = ()) -> LogMapping:
    """The mapping of a log.

    Args:
        path: its folder, in which recording.toml may lie, or such a file of any name.
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
    where = str(file)
    for name, section in table.items():
        if name not in SECTIONS:
            raise UserError(f"{where}: {name[:LONGEST]}: unknown section; {did_you_mean(name, SECTIONS)}")
        if not isinstance(section, dict):
            raise UserError(f"{where}: {name}: must be a section; write [{name}]")
    made = {name: _section(kind, table.get(name, {}), f"{where}: {name}") for name, kind in SECTIONS.items()}
    mapping = LogMapping(file.parent, where, **made)
    _require_sizes(mapping)
    return mapping


def _section(kind: type[Section], table: Mapping[str, Any], where: str) -> Section:
    """A section of its table; every value of the type that its field has."""
    hints = get_type_hints(kind)
    names = [each.name for each in fields(kind)]  # pyright: ignore[reportArgumentType]
    for key in table:
        if key not in names:
            raise UserError(f"{where}.{key[:LONGEST]}: unknown key; {did_you_mean(key, names)}")
    return kind(**{key: _value(value, hints[key], f"{where}.{key}") for key, value in table.items()})


def _value(value: object, hint: Any, where: str) -> object:
    """The value as its hint has it, or one line that says what it must be."""
    hint = next((each for each in get_args(hint) if each is not NoneType), hint) if NoneType in get_args(hint) else hint
    if get_origin(hint) is Literal:
        fits, must = value in get_args(hint), f"one of {', '.join(get_args(hint))}"
    elif hint is float:
        fits, must = _is_number(value), "a number"
    elif hint is str:
        fits, must = isinstance(value, str) and value != "", "a text"
    elif get_origin(hint) is tuple:
        fits, must = isinstance(value, list) and len(value) == 3 and all(map(_is_number, value)), "three numbers"
    else:
        fits = isinstance(value, dict) and all(type(each) in (str, int) for each in value.values())
        must = "a table of columns' names or numbers"
    if not fits:
        raise UserError(f"{where}: must be {must}, not {str(value)[:40]!r}; correct it")
    return value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST


def _require_sizes(mapping: LogMapping) -> None:
    """Refuse standard deviations and gaps below zero, and none at all of the sensor."""
    noise = {key: value for key, value in asdict(mapping.noise).items() if isinstance(value, float | int)}
    for key, value in noise.items():
        if value < 0.0 or (value == 0.0 and key in ("range", "bearing", "position")):
            raise UserError(f"{mapping.where}: noise.{key}: {value:g} is no standard deviation; give one > 0")
    if min(mapping.start.sigmas) < 0.0:
        raise UserError(f"{mapping.where}: start.sigmas: none may be negative; correct them")
    if mapping.truth.max_gap < 0.0:
        raise UserError(f"{mapping.where}: truth.max_gap: {mapping.truth.max_gap:g} s; give seconds >= 0")
