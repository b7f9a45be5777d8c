"""JSON held against its schema."""

from __future__ import annotations

from functools import cache
from typing import Any

from jsonschema import Draft202012Validator

from slamgauge.compare.schemas.kinds import SCHEMAS


@cache
def _validator(kind: str) -> Any:
    Draft202012Validator.check_schema(SCHEMAS[kind])
    return Draft202012Validator(SCHEMAS[kind])


def complaints(kind: str, content: object) -> list[str]:
    """What of JSON of a kind is not as its schema says, each with its place."""
    return [f"{error.json_path}: {error.message[:200]}" for error in _validator(kind).iter_errors(content)]


def held(kind: str, content: Any) -> Any:
    """The same JSON, which is as its schema says."""
    assert complaints(kind, content) == []
    return content
