"""Columns of a CSV file by their meaning, in metres, radians and seconds.

Names have units in brackets or behind a _ (range_mm), and other words for them. A pose may have a quaternion instead of
its heading, and a stamp may be a time of ISO 8601, or seconds and nanoseconds in two columns.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.csv_mapping import UNITS, FileTable
from slamgauge.compare.storage.csv_folder import from_triangles
from slamgauge.compare.storage.text_lines import Line, csv_lines, number_of, read_whole, require_width
from slamgauge.compare.storage.trajectories import planar_poses
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

SYNONYMS = {
    "stamp": ("time", "timestamp", "t"),
    "sec": ("secs",),
    "nsec": ("nsecs", "nanosec"),
    "v": ("speed", "velocity"),
    "omega": ("yaw_rate", "yawrate", "yaw rate"),
    "theta": ("heading", "yaw"),
    "landmark": ("id", "landmark_id"),
    "range": ("distance",),
}
STAMP = ("stamp", "sec", "nsec")
QUATERNION = ("qx", "qy", "qz", "qw")
DIMENSIONS = {
    "time": (("stamp",), ("s", "ms", "us", "ns")),
    "length": (("dx", "dy", "v", "vy", "x", "y", "range"), ("m", "cm", "mm")),
    "angle": (("dtheta", "omega", "theta", "bearing"), ("rad", "deg")),
}
QUANTITIES = {name: key for key, (names, _) in DIMENSIONS.items() for name in names}
WORDS = {word: name for name in (*QUANTITIES, *SYNONYMS) for word in (name, *SYNONYMS.get(name, ()))}
RATES = ("v", "vy", "omega")  # their units are per second
SPELLINGS = {"°": "deg", "degrees": "deg", "radians": "rad", "sec": "s", "seconds": "s", "µs": "us", "metres": "m"}
NAME_AND_UNIT = re.compile(r"(.*?)\s*[\[(]([^\])]*)[\])]")


class Column(NamedTuple):
    """A column: its text in the header, its name without the unit, and its unit, "" without one."""

    text: str
    name: str
    unit: str


class CsvTable:
    """A CSV file with its rows; `unused` has the columns that nothing has read."""

    def __init__(self, path: Path, section: FileTable, names: dict[str, str], known: Sequence[str]) -> None:
        """Read a file.

        Args:
            path: The file.
            section: Units where the header has none.
            names: The file's own names of our columns.
            known: Our columns, to which `names` may refer.

        Raises:
            UserError: the file cannot be read or has no header, or a name is unknown.
        """
        lines = csv_lines(path, read_whole(path))
        if not lines:
            raise UserError(f"{path}: no line in it; write a header and rows")
        self.header, self.rows = lines[0], lines[1:]
        if all(is_number_or_time(word) for word in self.header.words):
            raise self.header.refused("no header", "write a line with the names of the columns")
        require_width(lines)
        for name in names:
            if name not in known:
                raise UserError(f"{path}: columns.{name}: unknown column; {did_you_mean(name, known)}")
        self.section, self.names = section, names
        self.columns = [_column(text) for text in self.header.words]
        self.used: dict[int, str] = {}

    @property
    def unused(self) -> list[str]:
        """Names of the columns that were not used."""
        return [each.text for at, each in enumerate(self.columns) if at not in self.used and each.text]

    def has(self, *names: str) -> bool:
        """Return whether the file has all of these columns; headings may be quaternions."""
        return all(self._place(name) is not None or (name == "theta" and self.has(*QUATERNION)) for name in names)

    def numbers(self, name: str, default: float | None = None) -> Float:
        """Return the values (n,) of a column in our units, or the default without the column."""
        if default is not None and not self.has(name):
            return np.full(len(self.rows), default)
        at = self._used(name)
        return self._factor(name, at) * np.array([line.number_at(at) for line in self.rows])

    def steps(self) -> Float:
        """Return the whole numbers (n,) of the column `step`."""
        at = self._used("step")
        return np.array([line.id_at(at) for line in self.rows], dtype=np.float64)

    def sigmas(self, name: str) -> Float | None:
        """Return the standard deviations (n,) of a column in each row, from `range_std` or `range_sigma`."""
        for own in (f"{name}_std", f"{name}_sigma"):
            if self.has(own):
                at = self._used(own)
                found = np.array([line.number_at(at) for line in self.rows])
                if (found < 0.0).any():
                    raise self.rows[int(np.argmax(found < 0.0))].refused(f"{own} is negative", "correct it")
                return self._factor(name, self._place(name)) * found
        return None

    def covariances(self, names: Sequence[str]) -> Float | None:
        """Return covariances (n, d, d) of each row; `names` are the columns of their upper triangles, or nothing."""
        if not self.has(*names):
            return None
        dim = int((2 * len(names)) ** 0.5)
        return from_triangles(np.column_stack([self.numbers(name) for name in names]), dim)

    def poses(self) -> Float:
        """Return poses (n, 3) x, y, theta; headings are NaN if the file has none."""
        position = [self.numbers("x"), self.numbers("y")]
        if self._place("theta") is not None:
            return np.column_stack([*position, self.numbers("theta")])
        if not self.has(*QUATERNION):
            return np.column_stack([*position, np.full(len(self.rows), np.nan)])
        turns = [self.numbers(name) for name in QUATERNION]
        return planar_poses(np.column_stack([*position, np.zeros(len(self.rows)), *turns]))

    def stamps(self) -> tuple[Float, bool]:
        """Return the stamps (n,) [s], and whether they are times of ISO 8601, in seconds since 1970."""
        if not self.has("stamp") and self.has("sec", "nsec"):
            return self.numbers("sec") + 1e-9 * self.numbers("nsec"), False
        at = self._used("stamp")
        if not any(_is_time(line.words[at]) for line in self.rows[:1]):
            return self.numbers("stamp"), False
        return np.array([_seconds(line, at) for line in self.rows]), True

    def ids(self) -> list[int | str]:
        """Return the ids of landmarks: whole numbers or texts, -1 in all rows without the column."""
        if not self.has("landmark"):
            return [-1] * len(self.rows)
        at = self._used("landmark")
        return [_id(line, at) for line in self.rows]

    def _place(self, name: str) -> int | None:
        """Return the place of a column of ours: with the file's own name for it, else ours or another word for it."""
        words = [self.names[name].lower()] if name in self.names else [name, *SYNONYMS.get(name, ())]
        for word in words:
            found = [at for at, each in enumerate(self.columns) if word in (each.text.lower(), each.name.lower())]
            if len(found) > 1:
                raise self.header.refused(f"two columns are called {word!r}", "rename the one that is not used")
            if found:
                return found[0]
        return None

    def _used(self, name: str) -> int:
        """Return the place of a column that is read; refuse a missing one, and one that has another meaning."""
        at = self._place(name)
        if at is None:
            raise self.header.refused(f"no column {name}", f"name the file's own in columns: {name} = NAME")
        if self.used.setdefault(at, name) != name:
            raise self.header.refused(f"column {at + 1} is used for {self.used[at]} and {name}", "give each its own")
        return at

    def _factor(self, name: str, at: int | None) -> float:
        """Return the factor from a column to our unit: that of the header, else that of the settings.

        Raises:
            UserError: the header's unit is none of the quantity, or the settings state another unit.
        """
        dimension = QUANTITIES.get(name)
        if dimension is None or at is None:
            return 1.0
        given, stated = self.columns[at].unit, getattr(self.section, dimension)
        if not given:
            return UNITS[stated]
        known, end = DIMENSIONS[dimension][1], "/s" if name in RATES else ""
        unit = _spelt(given)
        if not unit.endswith(end) or unit.removesuffix(end) not in known:
            units = ", ".join(f"{each}{end}" for each in known)
            raise self.header.refused(f"{given[:20]!r} is not a unit of {name}", f"convert it to one of {units}")
        unit = unit.removesuffix(end)
        if stated not in (known[0], unit):
            what = f"{name} is in {unit} by the header, and in {stated} by the setting {dimension}"
            raise self.header.refused(what, "correct one of them")
        return UNITS[unit]


def _column(text: str) -> Column:
    found = NAME_AND_UNIT.fullmatch(text)
    if found:
        return Column(text, *found.groups())
    name, _, unit = text.rpartition("_")  # range_mm
    has_unit = WORDS.get(name.lower()) in QUANTITIES and _spelt(unit) in UNITS
    return Column(text, name, unit) if has_unit else Column(text, text, "")


def _spelt(unit: str) -> str:
    """Return a unit in our spelling."""
    word, slash, second = unit.strip().partition("/")
    return SPELLINGS.get(word, word) + slash + SPELLINGS.get(second, second)


def _id(line: Line, at: int) -> int | str:
    """Return an id: a whole number from -1, or a text that is not a number."""
    word = line.words[at]
    is_text = word != "" and np.isnan(number_of(word)) and word.lower() != "nan"
    return word if is_text else line.id_at(at, least=-1)


def _is_time(word: str) -> bool:
    return len(word) >= len("2024-05-01T12:00") and word[:4].isdecimal() and word[4] == "-"


def is_number_or_time(word: str) -> bool:
    """Return whether a word of a line cannot be the name of a column."""
    return _is_time(word) or not np.isnan(number_of(word))


def _seconds(line: Line, at: int) -> float:
    """Return a time of ISO 8601, UTC if it has no zone, as seconds since 1970."""
    try:
        found = datetime.fromisoformat(line.words[at])
    except ValueError:
        raise line.wrong_word(at, "is not a time", "write seconds, or 2024-05-01T12:00:00.25") from None
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()
