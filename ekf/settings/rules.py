"""Settings that check themselves: what a field may be stands beside its default, for all who read settings.

A field's rule is kept in its metadata, so that readers of files can apply it to a single key and name that key.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import Field, field, fields
from functools import cache
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from slamgauge.errors import UserError
from slamgauge.near_names import did_you_mean

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


def mistake_of(each: Field[Any], owner: type, value: object) -> str:
    """What is wrong with a value of a field, and a remedy; nothing if it can be."""
    words = choices(owner).get(each.name)
    if words is not None:
        return "" if value in words else f"{value!r} is not known; {did_you_mean(str(value), words)}"
    holds: Callable[[object], bool] | None = each.metadata.get(_HOLDS)
    return "" if holds is None or holds(value) else each.metadata[_MISTAKE].format(value)


@cache
def choices(owner: type) -> dict[str, tuple[str, ...]]:
    """The words that fields of a dataclass choose among, by field."""
    hints = get_type_hints(owner)
    return {key: get_args(hint) for key, hint in hints.items() if get_origin(hint) is Literal}


def check(settings: Any) -> None:
    """Refuse settings that break a field's rule; a whole number where a float is meant becomes one.

    Raises:
        UserError: naming the field, its value and a remedy.
    """
    for each in fields(settings):
        mistake = mistake_of(each, type(settings), getattr(settings, each.name))
        if mistake:
            raise UserError(f"{each.name}: {mistake}")
        value = getattr(settings, each.name)
        if isinstance(each.default, float) and type(value) is int:  # kernels would be compiled anew for it
            object.__setattr__(settings, each.name, float(value))


def is_fitted(each: Field[Any]) -> bool:
    """Whether the field has a value of its own for every sensor."""
    return each.metadata.get(_FITTED) is not None


def fitted(kind: type[Settings], reach: float, **chosen: object) -> Settings:
    """Settings of a dataclass for a sensor that sees `reach` [m]: what is not chosen, or None, follows from it.

    Raises:
        UserError: the settings break a rule.
    """
    given = {key: value for key, value in chosen.items() if value is not None}
    suited = {each.name: each.metadata[_FITTED](reach) for each in fields(kind) if is_fitted(each)}  # pyright: ignore[reportArgumentType]
    return kind(**{**suited, **given})
