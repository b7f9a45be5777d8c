"""Estimators that need GTSAM, on a system that does not have it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NoReturn

from slamgauge.errors import UserError


def unavailable(name: str, alternative: str, error: ImportError) -> Callable[..., NoReturn]:
    """Return a function called `name` that raises a UserError of one line, which names an `alternative` estimator."""
    reason = str(error).splitlines()[0]

    def missing(*_: object, **__: object) -> NoReturn:
        raise UserError(f"needs GTSAM, which cannot be had here ({reason}); {alternative} does without it")

    missing.__name__ = name
    return missing
