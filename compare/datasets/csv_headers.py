"""Headers of CSV files: names of columns, other words for them, and units in brackets or behind a _ (range_mm)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from slamgauge.compare.datasets.csv_mapping import UNITS, FileTable
from slamgauge.compare.datasets.text_lines import Line

SYNONYMS = {
    "stamp": ("time", "timestamp", "t"),
    "v": ("speed", "velocity"),
    "omega": ("yaw_rate", "yawrate", "yaw rate"),
    "theta": ("heading", "yaw"),
    "landmark": ("id", "landmark_id"),
    "range": ("distance",),
}
DIMENSIONS = {
    "time": (("stamp",), ("s", "ms", "us", "ns")),
    "length": (("dx", "dy", "v", "vy", "x", "y", "range"), ("m", "cm", "mm")),
    "angle": (("dtheta", "omega", "theta", "bearing"), ("rad", "deg")),
}
QUANTITIES = {each for names, _ in DIMENSIONS.values() for name in names for each in (name, *SYNONYMS.get(name, ()))}
RATES = ("v", "vy", "omega")  # their units are per second
SPELLINGS = {"°": "deg", "degrees": "deg", "radians": "rad", "sec": "s", "seconds": "s", "µs": "us", "metres": "m"}
NO_UNITS = ("", "-", "id")
NAME_AND_UNIT = re.compile(r"(.*?)\s*[\[(]([^\])]*)[\])]")


class Column(NamedTuple):
    """A column: its text in the header, its name without the unit, and its unit, None if the header has none."""

    text: str
    name: str
    unit: str | None


def columns_of(header: Line, units: Line | None) -> list[Column]:
    """Return the columns that a header names, with the units of the row below it if that is a row of units."""
    texts = [word.lstrip("#%").strip() for word in header.words]
    columns = [_column(text) for text in texts]
    if units is None:
        return columns
    if len(units.words) != len(columns):
        raise units.refused(f"has {len(units.words)} units for {len(columns)} columns", "write one for each, or none")
    return [column._replace(unit=word.strip("[]()")) for column, word in zip(columns, units.words, strict=True)]


def _column(text: str) -> Column:
    found = NAME_AND_UNIT.fullmatch(text)
    if found:
        return Column(text, *found.groups())
    name, _, unit = text.rpartition("_")  # range_mm
    return (
        Column(text, name, unit) if name.lower() in QUANTITIES and _spelt(unit) in UNITS else Column(text, text, None)
    )


def is_row_of_units(line: Line) -> bool:
    """Return whether a line has only units, with or without brackets, and at least one of them."""
    words = [word.strip("[]()") for word in line.words]
    units = [word for word in words if word not in NO_UNITS]
    return bool(units) and all(_spelt(word).removesuffix("/s") in UNITS for word in units)


def place_of(name: str, own: str | None, columns: Sequence[Column]) -> int | None:
    """Return the place of a column of ours: of the text `own`, or of its name or another word for it."""
    words = (name, *SYNONYMS.get(name, ())) if own is None else (own.lower(),)
    for word in words:
        for at, column in enumerate(columns):
            if word in (column.text.lower(), column.name.lower()):
                return at
    return None


def require_distinct(header: Line, used: dict[str, int], columns: Sequence[Column]) -> None:
    """Refuse one column for two quantities, and two columns with the name of one that is used.

    Args:
        header: The line of the header, or the first row.
        used: Place of the column of each quantity.
        columns: All columns; without a header none.
    """
    quantity: dict[int, str] = {}
    for name, at in used.items():
        if at in quantity:
            raise header.refused(f"column {at + 1} is used for {quantity[at]} and {name}", "give each its own column")
        quantity[at] = name
    names = [column.name.lower() for column in columns]
    for at, name in enumerate(names):
        if at in quantity and names.count(name) > 1:
            raise header.refused(f"two columns are called {columns[at].name!r}", "rename the one that is not used")


def factor_of(header: Line, name: str, given: str | None, table: FileTable) -> float:
    """Return the factor from a quantity to metres, radians and seconds.

    Its unit is the `given` one of the header, else that of the settings.
    """
    dimension = next((key for key, (names, _) in DIMENSIONS.items() if name in names), None)
    if dimension is None:
        return 1.0
    stated = getattr(table, dimension)
    if given is None or given in NO_UNITS:
        return UNITS[stated]
    known = DIMENSIONS[dimension][1]
    end = "/s" if name in RATES else ""
    unit = _spelt(given)
    if not unit.endswith(end) or unit.removesuffix(end) not in known:
        units = ", ".join(f"{each}{end}" for each in known)
        raise header.refused(f"{given[:20]!r} is not a unit of {name}", f"convert it to one of {units}")
    unit = unit.removesuffix(end)
    if stated not in (known[0], unit):
        what = f"{name} is in {unit} by the header, and in {stated} by the setting {dimension}"
        raise header.refused(what, "correct one of them")
    return UNITS[unit]


def _spelt(unit: str) -> str:
    """Return a unit in our spelling."""
    word, slash, second = unit.strip().partition("/")
    return SPELLINGS.get(word, word) + slash + SPELLINGS.get(second, second)
