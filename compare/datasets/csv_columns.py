"""Columns of a CSV file by their meaning, in metres, radians and seconds.

Names have units in brackets or behind a _ (range_mm), and other words for them. A pose may have a quaternion instead of
its heading, and a stamp may be a time of ISO 8601, or seconds and nanoseconds in two columns.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from math import isnan, pi
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.imported_log import require_rows
from slamgauge.compare.datasets.log_settings import FileTable
from slamgauge.compare.storage.csv_folder import from_triangles
from slamgauge.compare.storage.text_lines import Line, csv_lines, number_of, read_whole
from slamgauge.compare.storage.trajectories import planar_poses
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

WORDS: dict[str, tuple[str, ...]] = {  # our columns, and other words for them
    "stamp": ("time", "timestamp", "t"),
    "sec": ("secs",),
    "nsec": ("nsecs", "nanosec"),
    "v": ("speed", "velocity"),
    "omega": ("yaw_rate", "yawrate", "yaw rate"),
    "theta": ("heading", "yaw"),
    "landmark": ("id", "landmark_id"),
    "range": ("distance",),
    **dict.fromkeys(("step", "dx", "dy", "dtheta", "vy", "x", "y", "bearing", "qx", "qy", "qz", "qw"), ()),
}
QUATERNION = ("qx", "qy", "qz", "qw")
RATES = ("v", "vy", "omega")  # their units are per second
QUANTITIES = {
    **dict.fromkeys(("dx", "dy", "v", "vy", "x", "y", "range"), "length"),
    **dict.fromkeys(("dtheta", "omega", "theta", "bearing"), "angle"),
    "stamp": "time",
}
UNITS = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "µs": 1e-6, "sec": 1.0, "seconds": 1.0},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "metres": 1.0},
    "angle": {"rad": 1.0, "deg": pi / 180, "°": pi / 180, "degrees": pi / 180, "radians": 1.0},
}
NAME_AND_UNIT = re.compile(r"(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]")


class CsvTable:
    """A CSV file with its rows; `has_times` is whether stamps that were read are times of ISO 8601."""

    def __init__(self, path: str, section: FileTable, names: Mapping[str, str]) -> None:
        """Read a file; `section` has units where the header has none, `names` the file's own names of our columns."""
        self.path = Path(path)
        lines = csv_lines(self.path, read_whole(self.path))
        if not lines:
            raise UserError(f"{path}: no line in it; write a header and rows")
        self.header, self.rows = lines[0], lines[1:]
        for row in self.rows:
            row.require(self.header.words)
        for name in names:
            if name not in WORDS:
                raise UserError(f"{path}: columns.{name}: unknown column; {did_you_mean(name, WORDS)}")
        self.section, self.names = section, names
        self.columns = [_name_and_unit(text) for text in self.header.words]
        self.used: dict[int, str] = {}
        self.has_times = False

    def unused(self) -> list[str]:
        """Return a note about the columns that nothing has read, if there are any."""
        texts = [text for at, text in enumerate(self.header.words) if at not in self.used and text]
        return [f"{self.path.name}: columns that are not used: {', '.join(texts)}"] if texts else []

    def has(self, *names: str) -> bool:
        """Return whether the file has all of these columns; headings may be quaternions."""
        return all(self._place(name) is not None or (name == "theta" and self.has(*QUATERNION)) for name in names)

    def numbers(self, name: str, default: float | None = None) -> Float:
        """Return the values (n,) of a column in our units, or the default without the column."""
        if default is not None and not self.has(name):
            return np.full(len(self.rows), default)
        at = self._used(name)
        return self._factor(name, at) * np.array([line.number_at(at) for line in self.rows])

    def sigmas(self, name: str) -> Float | None:
        """Return the standard deviations (n,) of a column in each row, from `range_std` or `range_sigma`."""
        for own in (f"{name}_std", f"{name}_sigma"):
            if self.has(own):
                found = self.numbers(own)
                require_rows(self.rows, found < 0.0, f"{own} is negative", "correct it")
                return self._factor(name, self._place(name)) * found
        return None

    def covariances(self, names: Sequence[str]) -> Float | None:
        """Return covariances (n, d, d) of each row; `names` are the columns of their upper triangles, or nothing."""
        if not self.has(*names):
            return None
        return from_triangles(np.column_stack([self.numbers(name) for name in names]))

    def poses(self) -> Float:
        """Return poses (n, 3) x, y, theta; headings are NaN if the file has none."""
        position, nothing = [self.numbers("x"), self.numbers("y")], np.zeros(len(self.rows))
        if self._place("theta") is None and self.has(*QUATERNION):
            return planar_poses(np.column_stack([*position, nothing, *map(self.numbers, QUATERNION)]))
        return np.column_stack([*position, self.numbers("theta", np.nan)])

    def stamps(self) -> Float:
        """Return the stamps (n,) [s]; times of ISO 8601 are seconds since 1970."""
        if not self.has("stamp") and self.has("sec", "nsec"):
            return self.numbers("sec") + 1e-9 * self.numbers("nsec")
        at = self._used("stamp")
        self.has_times = any(":" in line.words[at] for line in self.rows[:1])
        return np.array([_seconds(line, at) for line in self.rows]) if self.has_times else self.numbers("stamp")

    def ids(self) -> list[int | str]:
        """Return the ids of landmarks: whole numbers from -1, or texts; -1 in all rows without the column."""
        if not self.has("landmark"):
            return [-1] * len(self.rows)
        at = self._used("landmark")
        words = [line.words[at] for line in self.rows]
        is_text = [isnan(number_of(word)) and word.lower() not in ("", "nan") for word in words]
        return [words[row] if is_text[row] else line.id_at(at, least=-1) for row, line in enumerate(self.rows)]

    def _place(self, name: str) -> int | None:
        """Return the place of a column of ours: with the file's own name for it, else ours or another word for it."""
        words = [self.names[name].lower()] if name in self.names else [name, *WORDS.get(name, ())]
        for word in words:
            names = zip(self.header.words, self.columns, strict=True)
            found = [at for at, (text, (plain, _)) in enumerate(names) if word in (text.lower(), plain.lower())]
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
        """Return the factor from a column to our unit: that of the header, else that of the settings."""
        dimension = QUANTITIES.get(name)
        if dimension is None or at is None:
            return 1.0
        stated, known = getattr(self.section, dimension), UNITS[dimension]
        given = self.columns[at][1]
        if not given:
            return known[stated]
        unit, slash, time = given.partition("/")
        if unit not in known or bool(slash) != (name in RATES) or (slash and UNITS["time"].get(time) != 1.0):
            units = ", ".join(f"{each}/s" if name in RATES else each for each in known)
            raise self.header.refused(f"{given[:20]!r} is not a unit of {name}", f"convert it to one of {units}")
        if known[stated] not in (1.0, known[unit]):
            what = f"{name} is in {unit} by the header, and in {stated} by the setting {dimension}"
            raise self.header.refused(what, "correct one of them")
        return known[unit]


def _name_and_unit(text: str) -> tuple[str, str]:
    """Return the name of a column without its unit, and the unit, "" without one."""
    found = NAME_AND_UNIT.fullmatch(text)
    if found:
        return found[1], found[2]
    name, _, unit = text.rpartition("_")  # range_mm
    is_ours = any(name.lower() in (ours, *WORDS[ours]) for ours in QUANTITIES)
    return (name, unit) if is_ours and any(unit in units for units in UNITS.values()) else (text, "")


def _seconds(line: Line, at: int) -> float:
    """Return a time of ISO 8601, UTC if it has no zone, as seconds since 1970."""
    try:
        found = datetime.fromisoformat(line.words[at])
    except ValueError:
        raise line.refused("is not a time", "write seconds, or 2024-05-01T12:00:00.25", at) from None
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()
