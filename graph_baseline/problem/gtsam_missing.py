"""Substitutes for estimators that need GTSAM, if it is not installed."""

from __future__ import annotations

from collections.abc import Callable
from typing import NoReturn

from slamgauge.errors import UserError


def unavailable(name: str, alternative: str, error: ImportError) -> Callable[..., NoReturn]:
    """Return a function `name` that raises a UserError with the import `error` and an `alternative` estimator."""
    reason = str(error).splitlines()[0]

    def missing(*_: object, **__: object) -> NoReturn:
        raise UserError(f"needs GTSAM, which cannot be imported ({reason}); use {alternative}, which does not need it")

    missing.__name__ = name
    return missing
