"""The words in which schemas are written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Schema = dict[str, Any]
DRAFT = "https://json-schema.org/draft/2020-12/schema"


def text(help: str = "") -> Schema:
    """A string."""
    return _told({"type": "string"}, help)


def number(help: str = "") -> Schema:
    """A number."""
    return _told({"type": "number"}, help)


def count(help: str = "") -> Schema:
    """A whole number that is not negative."""
    return _told({"type": "integer", "minimum": 0}, help)


def truth(help: str = "") -> Schema:
    """True or false."""
    return _told({"type": "boolean"}, help)


def one_of(values: Sequence[str], help: str = "") -> Schema:
    """One of some words."""
    return _told({"enum": [*values]}, help)


def known(schema: Schema) -> Schema:
    """The same, or null where it is not known or does not apply."""
    if "$ref" in schema or "enum" in schema:
        help = schema.get("description", "")
        return _told({"anyOf": [{k: v for k, v in schema.items() if k != "description"}, {"type": "null"}]}, help)
    return {**schema, "type": [schema["type"], "null"]}


def several(items: Schema, help: str = "", length: int | None = None) -> Schema:
    """A list."""
    ends = {} if length is None else {"minItems": length, "maxItems": length}
    return _told({"type": "array", "items": items, **ends}, help)


def by_name(values: Schema, help: str = "") -> Schema:
    """An object whose keys are names."""
    return _told({"type": "object", "additionalProperties": values}, help)


def record(fields: Mapping[str, Schema], help: str = "", optional: Mapping[str, Schema] | None = None) -> Schema:
    """An object with these keys, and those that may be missing, and no others."""
    found = {
        "type": "object",
        "properties": {**fields, **(optional or {})},
        "required": [*fields],
        "additionalProperties": False,
    }
    return _told(found, help)


def interval(help: str = "") -> Schema:
    """A mean with the ends of its 95 % interval."""
    return _told({"$ref": "#/$defs/interval"}, help)


def document(title: str, help: str, schema: Schema) -> Schema:
    """A whole schema."""
    definitions = {"interval": INTERVAL} if "#/$defs/interval" in str(schema) else {}
    found = {"$schema": DRAFT, "title": title, "description": help, **schema}
    return {**found, "$defs": definitions} if definitions else found


def _told(schema: Schema, help: str) -> Schema:
    return {**schema, "description": help} if help else schema


INTERVAL = record(
    {
        "mean": number(),
        "low": known(number("null where one run has no spread")),
        "high": known(number()),
    },
    "a mean with the ends of its 95 % interval",
)
ORIGIN: dict[str, Schema] = {
    "version": text("of slamgauge"),
    "command": known(text("that made it; null where Python did")),
    "scenario_text": known(text("the scenario as a TOML file, overrides included; null without one")),
}
