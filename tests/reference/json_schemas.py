"""Validation of JSON by the schemas in compare/schemas."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator
from referencing import Registry
from referencing.jsonschema import DRAFT202012

FOLDER = Path(__file__).parents[2] / "compare/schemas"
SCHEMAS: dict[str, Any] = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in FOLDER.glob("*.json")}
BY_FILE = [(f"{kind}.json", DRAFT202012.create_resource(schema)) for kind, schema in SCHEMAS.items()]


@cache
def _validator(kind: str) -> Any:
    Draft202012Validator.check_schema(SCHEMAS[kind])
    return Draft202012Validator(SCHEMAS[kind], registry=Registry().with_resources(BY_FILE))


def complaints(kind: str, content: object) -> list[str]:
    """Return a line, with its place, for each violation of the schema of this kind."""
    return [f"{error.json_path}: {error.message[:200]}" for error in _validator(kind).iter_errors(content)]


def held(kind: str, content: Any) -> Any:
    """Check that the schema of this kind accepts the content, and return it."""
    assert complaints(kind, content) == []
    return content
