"""Settings that check themselves: each field has a default and its bounds.

The bounds are in the field's metadata, so that readers of files can check a single key and name it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import Field, field, fields
from functools import cache
from numbers import Integral, Real
from typing import Any, Literal, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean
from slamgauge.validation import LARGEST

Value = TypeVar("Value", int, float)
Settings = TypeVar("Settings")


class Bounds(NamedTuple):
    """Bounds of a number; None means no bound."""

    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None

    def __contains__(self, value: object) -> bool:
        x: Any = value
        return not (
            (self.above is not None and not x > self.above)
            or (self.at_least is not None and not x >= self.at_least)
            or (self.below is not None and not x < self.below)
            or (self.at_most is not None and not x <= self.at_most)
        )

    def __str__(self) -> str:
        given = ((name.replace("_", " "), bound) for name, bound in self._asdict().items())
        return " and ".join(f"{name} {bound:g}" for name, bound in given if bound is not None)


def setting(default: Value, fitted: Callable[[float], float] | None = None, **bounds: float) -> Value:
    """Return a field with a default and bounds.

    Args:
        default: its value unless the user chooses another.
        fitted: the value for a sensor with a reach [m], if it depends on the reach.
        bounds: see `Bounds`.
    """
    metadata = {"bounds": Bounds(**bounds), "fitted": fitted}
    return field(default=default, metadata=metadata)


def is_number(value: object) -> bool:
    """Return whether a value is a real number; True and False are not."""
    return not isinstance(value, bool) and isinstance(value, Real)


def mistake_of(each: Field[Any], owner: type, value: object) -> str:
    """Return what is wrong with a value of a field, and a remedy; an empty text if nothing is wrong."""
    words = choices(owner).get(each.name)
    if words is not None:
        known = isinstance(value, str) and value in words
        return "" if known else f"{value!r} is not known; {did_you_mean(str(value), words)}"
    if "bounds" not in each.metadata:
        return ""
    bounds: Bounds = each.metadata["bounds"]
    if isinstance(each.default, float):
        if not (is_number(value) and math.isfinite(value)):  # pyrefly: ignore[bad-argument-type]
            return f"{value!r} is not a finite number; choose it {bounds}"
        if abs(float(value)) > LARGEST:  # pyrefly: ignore[bad-argument-type]
            return f"{value!r} is beyond {LARGEST:g}; choose a smaller one"
    elif not (is_number(value) and isinstance(value, Integral)):
        return f"{value!r} is not a whole number; choose it {bounds}"
    return "" if value in bounds else f"{value} is out of range; choose it {bounds}"


@cache
def choices(owner: type) -> dict[str, tuple[str, ...]]:
    """Return the possible words of the `Literal` fields of a dataclass, by field."""
    hints = get_type_hints(owner)
    return {key: get_args(hint) for key, hint in hints.items() if get_origin(hint) is Literal}


def check(settings: Any) -> None:
    """Refuse invalid settings; convert numbers to the Python type of the field.

    Raises:
        UserError: naming the field, its value and a remedy.
    """
    for each in fields(settings):
        value = getattr(settings, each.name)
        mistake = mistake_of(each, type(settings), value)
        if mistake:
            raise UserError(f"{each.name}: {mistake}")
        if "bounds" in each.metadata:  # numba would compile kernels again for another type
            object.__setattr__(settings, each.name, type(each.default)(value))


def is_fitted(each: Field[Any]) -> bool:
    """Return whether the value of a field depends on the sensor's reach."""
    return each.metadata.get("fitted") is not None


def fitted(kind: type[Settings], reach: float, **chosen: object) -> Settings:
    """Return settings for a sensor with a reach [m]; fields that are not chosen, or None, follow from the reach.

    Raises:
        UserError: an invalid setting, or `reach` is not a distance.
    """
    if not (is_number(reach) and 0.0 < reach < math.inf):
        raise UserError(f"reach: {reach!r} is not a distance; give metres above 0, for example 10")
    given = {key: value for key, value in chosen.items() if value is not None}
    suited = {each.name: each.metadata["fitted"](reach) for each in fields(kind) if is_fitted(each)}  # pyrefly: ignore[bad-argument-type]
    return kind(**{**suited, **given})
