"""What TOML files and `--set` say, as nested tables."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slamgauge.compare.storage.files import explained
from slamgauge.errors import UserError

Table = dict[str, Any]


def parse_toml(text: str) -> Table:
    """`tomllib.loads`, by which what no table can hold is not valid TOML either.

    Raises:
        tomllib.TOMLDecodeError: where and why.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except RecursionError:
        raise tomllib.TOMLDecodeError("brackets within brackets, too many for Python") from None
    except ValueError:  # of `int`, which refuses some thousands of digits
        raise tomllib.TOMLDecodeError("a number has too many digits for Python") from None


def read_toml(path: Path) -> Table:
    """The tables of a TOML file; `UserError` with the line if it is none."""
    with explained(path, "read"):
        content = path.read_bytes()
    try:
        return parse_toml(content.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise UserError(f"{path}: not a text in UTF-8; save it as such") from None
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{path}: not valid TOML: {error}; correct that line") from None


def override(table: Table, text: str) -> None:
    """Set the key of one `dotted.key=value` in the table, sections on the way included.

    The value is read as TOML, or as a bare string where it is not valid TOML.

    Raises:
        UserError: there is no key or no value.
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
        table[key] = parse_toml(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        table[key] = value.strip()


def write_toml(path: Path, sections: Mapping[str, Mapping[str, Any]]) -> None:
    """Write `toml_text` into a file."""
    with explained(path, "written"):
        path.write_text(toml_text(sections), encoding="utf-8")


def toml_text(sections: Mapping[str, Mapping[str, Any]]) -> str:
    """Sections of texts, numbers, lists and tables; what is None is left out, "" is for keys before all sections."""
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
