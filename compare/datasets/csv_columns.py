"""Columns of a CSV file by their meaning, in metres, radians and seconds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.csv_mapping import KINDS, UNITS, FileTable
from slamgauge.compare.datasets.text_lines import REMARKS, Line, read_lines
from slamgauge.errors import UserError
from slamgauge.sensors import SENSORS

OPTIONAL = {"increments": "dy", "velocities": "vy"} | dict.fromkeys(SENSORS, "landmark")
WITHOUT = {"dy": 0.0, "vy": 0.0, "landmark": -1.0}  # values of an optional column that is missing
DIMENSIONS = {
    "time": ("stamp",),
    "length": ("dx", "dy", "v", "vy", "x", "y", "range"),
    "angle": ("dtheta", "omega", "theta", "bearing"),
}


class Rows(NamedTuple):
    """Values (n, k) of a CSV file, in the order of the columns of its kind, and the lines they are on."""

    kind: str
    lines: Sequence[Line]
    values: Float


def read_columns(path: Path, table: FileTable, kinds: Sequence[str], section: str, kind: str | None = None) -> Rows:
    """Read the columns of a file: by their names, or by their order if it has no header.

    Args:
        path: The file.
        table: Its columns and units.
        kinds: Kinds that the file may be; the one whose columns it has is chosen.
        section: Section of recording.toml for the file (for messages).
        kind: The kind of the file, if it is stated there.

    Raises:
        UserError: the file does not have the columns, or a row is wrong; with its line.
    """
    lines = list(read_lines(path, comment="", separators=",;\t"))
    if not lines:
        raise UserError(f"{path}: no line in it; write a header and rows")
    header, rows = _header(lines)
    names = [word.strip('"').lstrip("#%").strip() for word in header.words]
    has_header = not all(map(_is_number, names))
    if not has_header and kind is None:
        remedy = f"write one, or give the kind of its columns with {section}.kind"
        raise header.refused(f"no header, and {section}.kind is not given", remedy)
    candidates = [kind] if kind is not None else list(kinds)
    found = {each: at for each in candidates if (at := _places(table, each, names, has_header)) is not None}
    found = {each: at for each, at in found.items() if not any({*KINDS[each]} < {*KINDS[other]} for other in found)}
    if len(found) > 1:
        raise header.refused(f"could be {' or '.join(found)}", f"give the kind with {section}.kind")
    if not found:
        forms = " or ".join(",".join(KINDS[each]) for each in candidates)
        raise header.refused(f"does not have the columns {forms}", f"name its own in {section}.columns")
    ((kind, places),) = found.items()
    return Rows(kind, rows, _values(table, rows, kind, places, len(names)))


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


def _places(table: FileTable, kind: str, names: list[str], has_header: bool) -> list[int | None] | None:
    """Return the place of each column of a kind, None for an optional one that is missing; None if another is."""
    wanted, optional = KINDS[kind], OPTIONAL.get(kind)
    if not has_header:
        in_order = wanted if len(names) >= len(wanted) else tuple(name for name in wanted if name != optional)
        numbers = {name: at for at, name in enumerate(in_order, 1)} | table.columns
        places = [numbers.get(name) for name in wanted]
    else:
        own = [table.columns.get(name, name) for name in wanted]
        places = [name if isinstance(name, int) else names.index(name) + 1 if name in names else None for name in own]
    fits = all(isinstance(at, int) and 0 < at <= len(names) for at in places if at is not None)
    lacks = any(at is None and name != optional for name, at in zip(wanted, places, strict=True))
    return [at - 1 if isinstance(at, int) else None for at in places] if fits and not lacks else None


def _values(table: FileTable, rows: list[Line], kind: str, places: list[int | None], width: int) -> Float:
    values = np.empty((len(rows), len(places)))
    for at, line in enumerate(rows):
        if len(line.words) != width:
            raise line.refused(f"has {len(line.words)} columns where the first line has {width}", "correct the line")
        line.words[:] = [word.strip('"') for word in line.words]
        for column, (name, place) in enumerate(zip(KINDS[kind], places, strict=True)):
            if place is None:
                values[at, column] = WITHOUT[name]
            else:
                values[at, column] = line.id_at(place, least=-1) if name == "landmark" else line.number_at(place)
    for dimension, names in DIMENSIONS.items():
        values[:, [name in names for name in KINDS[kind]]] *= UNITS[getattr(table, dimension)]
    return values


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
