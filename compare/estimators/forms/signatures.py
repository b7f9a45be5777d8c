"""Parameters of user functions and classes."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

Callee = Callable[..., Any]


def parameters(given: object) -> list[inspect.Parameter]:
    """Return the positional parameters; an empty list if Python cannot read the signature."""
    try:
        found = inspect.signature(given).parameters.values()  # pyrefly: ignore[bad-argument-type]
    except (TypeError, ValueError):
        return []
    return [each for each in found if each.kind in (each.POSITIONAL_ONLY, each.POSITIONAL_OR_KEYWORD)]


def required(given: object) -> list[str]:
    """Return the names of the positional parameters without a default."""
    return [each.name for each in parameters(given) if each.default is each.empty]


def spelt(given: object) -> str:
    """Return a callable with its parameters, for messages: `class EKF(Q, R)`."""
    kind = "class " if isinstance(given, type) else ""
    return f"{kind}{getattr(given, '__name__', repr(given))}({', '.join(each.name for each in parameters(given))})"
