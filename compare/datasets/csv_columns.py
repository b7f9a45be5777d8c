"""Columns of a CSV file by what they mean, in metres, radians and seconds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.csv_mapping import UNITS, Columns
from slamgauge.compare.datasets.text_lines import REMARKS, Line, read_lines
from slamgauge.errors import UserError
from slamgauge.sensors import SENSORS
from slamgauge.suggestions import did_you_mean

KINDS: dict[str, tuple[str, ...]] = {
    "increments": ("stamp", "dx", "dy", "dtheta"),
    "velocities": ("stamp", "v", "vy", "omega"),
    "poses": ("stamp", "x", "y", "theta"),
    **{name: ("stamp", "landmark", *model.columns) for name, model in SENSORS.items()},
    "landmarks": ("landmark", "x", "y"),
}
OPTIONAL = {"increments": "dy", "velocities": "vy"} | dict.fromkeys(SENSORS, "landmark")
WITHOUT = {"dy": 0.0, "vy": 0.0, "landmark": -1.0}  # what an optional column says where it is missing
DIMENSIONS = {
    "time": ("stamp",),
    "length": ("dx", "dy", "v", "vy", "x", "y", "range"),
    "angle": ("dtheta", "omega", "theta", "bearing"),
}


@dataclass(frozen=True)
class Source:
    """A CSV file, the names or numbers that its columns have there, and the units of time, length and angle."""

    path: Path
    columns: Columns
    units: Mapping[str, str]


@dataclass(frozen=True)
class Table:
    """The rows (n, k) of a CSV file, in the order of its kind's columns, and where they stand."""

    kind: str
    lines: Sequence[Line]
    values: Float


def read_columns(source: Source, kinds: Sequence[str], section: str, kind: str | None = None) -> Table:
    """The columns of a file that are told by their names, or by their order where it has no header.

    Args:
        source: The file.
        kinds: Of which the file is one: the one whose columns it has.
        section: Of recording.toml that says more of it.
        kind: The one that it is, if that was said.

    Raises:
        UserError: the file has not the columns, or a row is wrong; by its line.
    """
    lines = list(read_lines(source.path, comment="", separators=",;\t"))
    if not lines:
        raise UserError(f"{source.path}: no line in it; write a header and rows")
    header, rows = _header(lines)
    names = [word.strip('"').lstrip("#%").strip() for word in header.words]
    has_header = not all(map(_is_number, names))
    if not has_header and kind is None:
        remedy = f"write one, or say what its columns are with {section}.kind"
        raise header.refused(f"no header, and {section}.kind is not said", remedy)
    candidates = [kind] if kind is not None else list(kinds)
    found = [(each, places) for each in candidates if (places := _places(source, each, names, has_header)) is not None]
    found = [
        (each, places) for each, places in found if not any({*KINDS[each]} < {*KINDS[other]} for other, _ in found)
    ]
    if len(found) != 1:
        raise _undecided(header, candidates if not found else [each for each, _ in found], section, bool(found))
    return Table(found[0][0], rows, _values(source, rows, *found[0], len(names)))


def _header(lines: list[Line]) -> tuple[Line, list[Line]]:
    """The line that names the columns, or the first row if there is none, and the rows.

    Lines that begin with # or % are remarks. But the one above the first row names its columns if it has as many words.
    """
    said = [line for line in lines if not line.words[0].startswith(REMARKS)]
    if not said:
        return lines[-1], []
    above = next((line for line in reversed(lines) if line.number < said[0].number), None)
    if all(map(_is_number, said[0].words)):
        return (above, said) if above is not None and len(above.words) == len(said[0].words) else (said[0], said)
    return said[0], said[1:]


def _places(source: Source, kind: str, names: list[str], has_header: bool) -> list[int | None] | None:
    """Where each column of a kind stands in the file, None for one that may be missing; or None if one must not."""
    wanted, optional = KINDS[kind], OPTIONAL.get(kind)
    if not has_header:
        stand = wanted if len(names) >= len(wanted) else tuple(name for name in wanted if name != optional)
        numbers = {name: at for at, name in enumerate(stand, 1)} | source.columns
        places = [numbers.get(name) for name in wanted]
    else:
        own = [source.columns.get(name, name) for name in wanted]
        places = [name if isinstance(name, int) else names.index(name) + 1 if name in names else None for name in own]
    fits = all(isinstance(at, int) and 0 < at <= len(names) for at in places if at is not None)
    lacks = any(at is None and name != optional for name, at in zip(wanted, places, strict=True))
    return [at - 1 if isinstance(at, int) else None for at in places] if fits and not lacks else None


def _undecided(header: Line, kinds: Sequence[str], section: str, several: bool) -> UserError:
    if several:
        return header.refused(f"could be {' or '.join(kinds)}", f"say which with {section}.kind")
    forms = " or ".join(",".join(KINDS[kind]) for kind in kinds)
    return header.refused(f"has not the columns {forms}", f"name its own in {section}.columns")


def _values(source: Source, rows: list[Line], kind: str, places: list[int | None], width: int) -> Float:
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
        of_it = [name in names for name in KINDS[kind]]
        values[:, of_it] *= UNITS[source.units[dimension]]
    return values


def require_known(columns: Columns, kinds: Sequence[str], where: str) -> None:
    """Refuse a mapping of a column that no kind has."""
    known = list(dict.fromkeys(name for kind in kinds for name in KINDS[kind]))
    for name in columns:
        if name not in known:
            raise UserError(f"{where}.{name}: unknown column; {did_you_mean(name, known)}")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
