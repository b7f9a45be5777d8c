"""Parameters of tests that only `pytest --full` runs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def in_full(values: Iterable[Any]) -> list[Any]:
    """Mark values of `pytest.mark.parametrize` for the full run."""
    return [pytest.param(value, marks=pytest.mark.full) for value in values]
