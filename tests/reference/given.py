"""Optional fields that a test knows to be there."""

from __future__ import annotations

from typing import TypeVar

T = TypeVar("T")


def given(field: T | None) -> T:
    """Return a field that is not None."""
    assert field is not None
    return field
