"""Read and write TOML files, and apply `--set` overrides to nested tables."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slamgauge.compare.storage.files import explained, read_text
from slamgauge.errors import UserError

Table = dict[str, Any]


def read_toml(path: Path) -> Table:
    """Return the tables of a TOML file; raise `UserError` with the line if it is not valid."""
    text = read_text(path)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also of numbers and brackets beyond the limits of Python
        raise UserError(f"{path}: not valid TOML: {error}; correct that line") from None


def override(table: Table, text: str) -> None:
    """Set one `dotted.key=value` in the table; missing sections are created.

    The value is parsed as TOML; if that fails, it is taken as a string.

    Raises:
        UserError: If the key or the `=` is missing.
    """
    path, equals, value = text.partition("=")
    if not equals or not path.strip():
        raise UserError(f"{text[:100]}: not an override; write dotted.key=value")
    *sections, key = path.strip().split(".")
    for section in sections:
        if not isinstance(table.get(section), dict):
            table[section] = {}
        table = table[section]
    try:
        table[key] = tomllib.loads(f"value = {value}")["value"]
    except (ValueError, RecursionError):  # also of a number with more digits than Python reads
        table[key] = value.strip()


def write_toml(path: Path, sections: Mapping[str, Mapping[str, Any]]) -> None:
    """Write sections as a TOML file (see `toml_text`)."""
    with explained(path, "written"):
        path.write_text(toml_text(sections), encoding="utf-8")


def toml_text(sections: Mapping[str, Mapping[str, Any]]) -> str:
    """Return sections as TOML without their None values; section "" has the keys before all other sections."""
    lines: list[str] = []
    for name, section in sections.items():
        keys = [f"{key} = {_value(value)}" for key, value in section.items() if value is not None]
        lines += [*([f"[{name}]"] if name else []), *keys, ""]
    return "\n".join(lines)


def _value(value: object) -> str:
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{json.dumps(key)} = {_value(each)}' for key, each in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str | bool) else repr(value)
