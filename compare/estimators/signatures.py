"""Calls into people's code: its signature, and errors of old code on today's numpy told by line and remedy."""

from __future__ import annotations

import inspect
import traceback
from pathlib import Path

import numpy as np

from slamgauge.compare.estimators.fresh_modules import Fresh
from slamgauge.compare.estimators.user_code import SILENT, Callee, OwnCodeError

# what numpy says where an array stands in place of a number
NO_NUMBER = ("can be converted to Python scalars", "setting an array element with a sequence")


def parameters(given: object) -> list[inspect.Parameter]:
    """Those that can be given by position; none if it has no signature that Python can read."""
    try:
        found = inspect.signature(given).parameters.values()  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError):
        return []
    return [each for each in found if each.kind in (each.POSITIONAL_ONLY, each.POSITIONAL_OR_KEYWORD)]


def required(given: object) -> list[str]:
    """Names of the positional parameters without a default."""
    return [each.name for each in parameters(given) if each.default is each.empty]


def required_of_pair(given: Fresh, names: tuple[str, str], counts: tuple[int, int]) -> list[list[str]] | None:
    """`required` of two functions, one of which is given and the other stands beside it; None if that is not so.

    Args:
        given: one of them.
        names: of both.
        counts: how many parameters each requires.
    """
    functions = [given.beside.get(name) for name in names]
    found = [required(function) for function in functions]
    is_pair = given.callee in functions and [len(each) for each in found] == [*counts]
    return found if is_pair else None


def called(function: Callee, *arguments: object) -> object:
    """What the function returns.

    Raises:
        OwnCodeError: an array where numpy wants a number; and whatever the function raises.
    """
    try:
        return function(*arguments)
    except (TypeError, ValueError) as error:
        if not any(text in str(error) for text in NO_NUMBER):
            raise
        frames = traceback.extract_tb(error.__traceback__)
        theirs = [frame for frame in frames if Path(frame.filename).parent not in SILENT]
        if not theirs:
            raise
        at = theirs[-1]
        what = f"{Path(at.filename).name}, line {at.lineno}: `{at.line}` takes an array for a number"
        raise OwnCodeError(
            f"{what}, which numpy {np.__version__} refuses; write the element, u[0, 0] for u[0] of a column"
        ) from error


def pair(returned: object, name: str) -> list[object]:
    """The parts of a returned tuple, at least two.

    Raises:
        OwnCodeError: it is none.
    """
    if not isinstance(returned, tuple | list) or len(returned) < 2:
        kind = type(returned).__name__
        raise OwnCodeError(f"{name} returned a {kind}; return state and covariance")
    return [*returned]
