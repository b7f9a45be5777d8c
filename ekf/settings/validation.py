"""Settings that check themselves: what a field may be stands beside its default, for all who read settings.

A field's rule is kept in its metadata, so that readers of files can apply it to a single key and name that key.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import Field, field, fields
from functools import cache
from numbers import Integral, Real
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean
from slamgauge.validation import LARGEST

Value = TypeVar("Value", int, float)
Settings = TypeVar("Settings")

_HOLDS, _MISTAKE, _FITTED = "holds", "mistake", "fitted"


def setting(
    default: Value,
    holds: Callable[[Value], bool],
    mistake: str,
    fitted: Callable[[float], float] | None = None,
) -> Value:
    """A field with a default and a rule.

    Args:
        default: its value unless it is chosen.
        holds: whether a value can be.
        mistake: what is wrong with one that cannot, and a remedy; `{}` stands for the value.
        fitted: the value that suits a sensor by its reach [m], if it depends on that.
    """
    metadata = {_HOLDS: holds, _MISTAKE: mistake, _FITTED: fitted}
    return field(default=default, metadata=metadata)  # pyright: ignore[reportReturnType]


def gate_setting() -> float:
    """A field for the largest squared Mahalanobis distance at which an observation is a landmark's."""
    return setting(9.0, lambda g: g > 0.0, "{} lets nothing pass; choose it above 0")


def is_number(value: object) -> bool:
    """Whether a value is a real number; True and False are not."""
    return not isinstance(value, bool) and isinstance(value, Real)


def mistake_of(each: Field[Any], owner: type, value: object) -> str:
    """What is wrong with a value of a field, and a remedy; nothing if it can be."""
    words = choices(owner).get(each.name)
    if words is not None:
        known = isinstance(value, str) and value in words
        return "" if known else f"{value!r} is not known; {did_you_mean(str(value), words)}"
    if _HOLDS not in each.metadata:
        return ""
    holds: Callable[[object], bool] = each.metadata[_HOLDS]
    mistake: str = each.metadata[_MISTAKE]
    remedy = mistake.partition("; ")[2]
    if isinstance(each.default, float):
        if not (is_number(value) and math.isfinite(value)):  # pyright: ignore[reportArgumentType]
            return f"{value!r} is not a finite number; {remedy}"
        if abs(float(value)) > LARGEST:  # pyright: ignore[reportArgumentType]
            return f"{value!r} is beyond {LARGEST:g}; choose a smaller one"
    elif not (is_number(value) and isinstance(value, Integral)):
        return f"{value!r} is not a whole number; {remedy}"
    return "" if holds(value) else mistake.format(value)


@cache
def choices(owner: type) -> dict[str, tuple[str, ...]]:
    """The words that fields of a dataclass choose among, by field."""
    hints = get_type_hints(owner)
    return {key: get_args(hint) for key, hint in hints.items() if get_origin(hint) is Literal}


def require(owner: type, key: str, value: object) -> None:
    """Refuse a value that the field `key` of a dataclass of settings cannot have.

    Raises:
        UserError: naming the field, the value and a remedy.
    """
    (each,) = (each for each in fields(owner) if each.name == key)
    mistake = mistake_of(each, owner, value)
    if mistake:
        raise UserError(f"{key}: {mistake}")


def check(settings: Any) -> None:
    """Refuse settings that break a field's rule; numbers become plain ones of the field's own type.

    Raises:
        UserError: naming the field, its value and a remedy.
    """
    for each in fields(settings):
        value = getattr(settings, each.name)
        require(type(settings), each.name, value)
        if _HOLDS in each.metadata:  # kernels would be compiled anew for another type
            object.__setattr__(settings, each.name, type(each.default)(value))


def is_fitted(each: Field[Any]) -> bool:
    """Whether the field has a value of its own for every sensor."""
    return each.metadata.get(_FITTED) is not None


def fitted(kind: type[Settings], reach: float, **chosen: object) -> Settings:
    """Settings of a dataclass for a sensor that sees `reach` [m]: what is not chosen, or None, follows from it.

    Raises:
        UserError: the settings break a rule, or `reach` is no distance.
    """
    if not (is_number(reach) and 0.0 < reach < math.inf):
        raise UserError(f"reach: {reach!r} is not a distance; give metres above 0, for example 10")
    given = {key: value for key, value in chosen.items() if value is not None}
    suited = {each.name: each.metadata[_FITTED](reach) for each in fields(kind) if is_fitted(each)}  # pyright: ignore[reportArgumentType]
    return kind(**{**suited, **given})
