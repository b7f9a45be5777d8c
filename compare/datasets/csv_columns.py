"""Columns of a CSV file by their meaning, in metres, radians and seconds."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.csv_headers import (
    Column,
    columns_of,
    factor_of,
    is_row_of_units,
    place_of,
    require_distinct,
)
from slamgauge.compare.datasets.csv_mapping import KINDS, FileTable
from slamgauge.compare.datasets.text_lines import REMARKS, Line, read_lines
from slamgauge.compare.storage.csv_cells import is_numeric_text
from slamgauge.errors import UserError
from slamgauge.sensors import SENSORS

OPTIONAL = {"increments": "dy", "velocities": "vy"} | dict.fromkeys(SENSORS, "landmark")
WITHOUT = {"dy": 0.0, "vy": 0.0, "landmark": -1.0}  # values of an optional column that is missing


class Rows(NamedTuple):
    """Values (n, k) of a CSV file, in the order of the columns of its kind, their lines, and unused columns.

    `sigmas` has the standard deviations (n,) of columns that have some in each row: `range_std` or `range_sigma`.
    """

    kind: str
    lines: Sequence[Line]
    values: Float
    unused: tuple[str, ...]
    sigmas: dict[str, Float]


def read_columns(path: Path, table: FileTable, kinds: Sequence[str], section: str, kind: str | None = None) -> Rows:
    """Read the columns of a file: by their names, or by their order if it has no header.

    Args:
        path: The file.
        table: Its columns and units. Units in the header are used instead of the default ones.
        kinds: Kinds that the file may be; the one whose columns it has is chosen.
        section: Section of recording.toml for the file (for messages).
        kind: The kind of the file, if it is stated there.

    Raises:
        UserError: the file does not have the columns, or a row is wrong; with its line.
    """
    lines = list(read_lines(path, comment="", separators=";\t,"))
    if not lines:
        raise UserError(f"{path}: no line in it; write a header and rows")
    header, rows = _header(lines)
    has_header = not all(map(_is_number, header.words))
    units = rows.pop(0) if has_header and rows and is_row_of_units(rows[0]) else None
    columns = columns_of(header, units)
    if not has_header and kind is None:
        remedy = f"write one, or give the kind of its columns with {section}.kind"
        raise header.refused(f"no header, and {section}.kind is not given", remedy)
    candidates = [kind] if kind is not None else list(kinds)
    found = {each: at for each in candidates if (at := _places(table, each, columns, has_header)) is not None}
    found = {each: at for each, at in found.items() if not any({*KINDS[each]} < {*KINDS[other]} for other in found)}
    if len(found) > 1:
        raise header.refused(f"could be {' or '.join(found)}", f"give the kind with {section}.kind")
    if not found:
        if "observations" in section and place_of("range", None, columns) is not None:
            raise header.refused("ranges without bearings", "range-only landmarks are not supported; add bearings")
        forms = " or ".join(",".join(KINDS[each]) for each in candidates)
        raise header.refused(f"does not have the columns {forms}", f"name its own in {section}.columns")
    ((kind, places),) = found.items()
    used = {name: at for name, at in zip(KINDS[kind], places, strict=True) if at is not None}
    require_distinct(header, used, columns if has_header else ())
    units_of = {name: columns[at].unit for name, at in used.items()} if has_header else {}
    factors = [factor_of(header, name, units_of.get(name), table) for name in KINDS[kind]]
    deviations = _deviations(KINDS[kind], columns) if has_header else {}
    used |= {f"{name}_std": at for name, at in deviations.items()}
    unused = tuple(each.text for at, each in enumerate(columns) if has_header and at not in used.values() and each.text)
    values = _values(rows, kind, places, len(columns)) * factors
    factor = dict(zip(KINDS[kind], factors, strict=True))
    sigmas = {name: factor[name] * np.array([line.number_at(at) for line in rows]) for name, at in deviations.items()}
    return Rows(kind, rows, values, unused, sigmas)


def _deviations(names: Sequence[str], columns: Sequence[Column]) -> dict[str, int]:
    """Return the places of the columns with standard deviations, in the units of the column that they belong to."""
    found = {column.name.lower(): at for at, column in enumerate(columns)}
    return {name: found[word] for name in names for word in (f"{name}_std", f"{name}_sigma") if word in found}


def _header(lines: list[Line]) -> tuple[Line, list[Line]]:
    """Return the line that names the columns (or the first row if no line does) and the rows.

    Lines that begin with # or % are remarks. The remark above the first row names the columns if it has as many words.
    """
    content = [line for line in lines if not line.words[0].startswith(REMARKS)]
    if not content:
        return lines[-1], []
    first = content[0]
    if not all(map(_is_number, first.words)):
        return first, content[1:]
    above = next((line for line in reversed(lines) if line.number < first.number), None)
    return (above if above is not None and len(above.words) == len(first.words) else first), content


def _places(table: FileTable, kind: str, columns: list[Column], has_header: bool) -> list[int | None] | None:
    """Return the place of each column of a kind, None for an optional one that is missing; None if another is."""
    wanted, optional = KINDS[kind], OPTIONAL.get(kind)
    if not has_header:
        in_order = wanted if len(columns) >= len(wanted) else tuple(name for name in wanted if name != optional)
        numbers = {name: at for at, name in enumerate(in_order, 1)} | table.columns
        own = [numbers.get(name) for name in wanted]
    else:
        own = [table.columns.get(name) for name in wanted]
    places = [
        each - 1 if isinstance(each, int) else place_of(name, each, columns)
        for name, each in zip(wanted, own, strict=True)
    ]
    fits = all(0 <= at < len(columns) for at in places if at is not None)
    lacks = any(at is None and name != optional for name, at in zip(wanted, places, strict=True))
    return places if fits and not lacks else None


def _values(rows: list[Line], kind: str, places: list[int | None], width: int) -> Float:
    """Return the numbers (n, k) of the columns at some places."""
    values = np.empty((len(rows), len(places)))
    for line in rows:
        if len(line.words) != width:
            raise line.refused(f"has {len(line.words)} columns where the first line has {width}", "correct the line")
    for column, (name, place) in enumerate(zip(KINDS[kind], places, strict=True)):
        if place is None:
            values[:, column] = WITHOUT[name]
        else:
            values[:, column] = [
                line.id_at(place, least=-1)
                if name == "landmark"
                else _stamp(line, place)
                if name == "stamp"
                else line.number_at(place)
                for line in rows
            ]
    return values


def _stamp(line: Line, place: int) -> float:
    """Return a stamp: a number, or a date and time of ISO 8601 (UTC if it has no zone) as seconds since 1970."""
    word = line.words[place]
    if len(word) < len("2024-05-01T12:00") or word[4:5] != "-":
        return line.number_at(place)
    try:
        found = datetime.fromisoformat(word)
    except ValueError:
        raise line.refused(f"{word[:40]!r} is not a time", "write seconds, or 2024-05-01T12:00:00.25") from None
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()


def _is_number(word: str) -> bool:
    """Return whether a word is a number, or a time, possibly with the mark of a comment in front."""
    word = word.lstrip("#%")
    return is_numeric_text(word) or (word[:4].isdecimal() and word[4:5] == "-")
