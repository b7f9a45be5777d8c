"""Calls of user functions: parameters, returned pairs, and a clear message where old code meets today's numpy."""

from __future__ import annotations

import inspect
from pathlib import Path

import numpy as np

from slamgauge.compare.estimators.user_code import Callee, UserCodeError, user_frames

# what numpy writes if an array is given for a number
NO_NUMBER = ("can be converted to Python scalars", "setting an array element with a sequence")


class ArrayForNumberError(UserCodeError):
    """User code takes an array for a number; `what` names file, line and source."""

    def __init__(self, what: str) -> None:
        self.what = what
        remedy = "write the element, u[0, 0] for u[0] of a column"
        super().__init__(f"{what}, which numpy {np.__version__} refuses; {remedy}")


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


def called(function: Callee, *arguments: object) -> object:
    """Call a user function.

    Raises:
        ArrayForNumberError: it passes an array to numpy where a number is needed.
        Exception: other errors of the function, unchanged.
    """
    try:
        return function(*arguments)
    except (TypeError, ValueError) as error:
        frames = user_frames(error)
        if not frames or not any(text in str(error) for text in NO_NUMBER):
            raise
        at = frames[-1]
        what = f"{Path(at.filename).name}, line {at.lineno}: `{at.line}` takes an array for a number"
        raise ArrayForNumberError(what) from error


def pair(returned: object, name: str) -> list[object]:
    """Return the parts of a returned tuple, at least two.

    Raises:
        UserCodeError: the function `name` returned something else.
    """
    if not isinstance(returned, tuple | list) or len(returned) < 2:
        raise UserCodeError(f"{name} returned a {type(returned).__name__}; return state and covariance")
    return [*returned]
