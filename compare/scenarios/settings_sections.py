"""Sections of scenario files that are made of a filter's settings: keys, defaults and rules, each kept once."""

from __future__ import annotations

from dataclasses import Field as DataclassField
from dataclasses import fields
from typing import Annotated, Any, TypeVar, get_type_hints

from pydantic import AfterValidator, BaseModel, Field, create_model
from pydantic_core import PydanticCustomError

from slamgauge.ekf.setting_rules import is_fitted, mistake_of
from slamgauge.validation import LARGEST


def _believable(number: float) -> float:
    if abs(number) > LARGEST:
        text = "must be at most {most} in size, not {number}"
        raise PydanticCustomError("size", text, {"most": f"{LARGEST:g}", "number": f"{number:g}"})
    return number


Number = Annotated[float, Field(strict=True), AfterValidator(_believable)]
Whole = Annotated[int, Field(strict=True)]
Section = TypeVar("Section", bound=BaseModel)

_STRICT = {float: Number, int: Whole}  # a file's "1" is no number, nor is true


def rule_of(settings: type, key: str) -> AfterValidator:
    """The rule of one field of a dataclass of settings, for one key of a file."""
    each = next(each for each in fields(settings) if each.name == key)

    def holds(value: object) -> object:
        mistake = "" if value is None else mistake_of(each, settings, value)
        if mistake:
            raise PydanticCustomError("rule", "{mistake}", {"mistake": mistake})
        return value

    return AfterValidator(holds)


def section_of(name: str, module: str, settings: type, base: type[Section]) -> type[Section]:
    """A section with the fields of a dataclass; None, where the sensor's range decides unless they are given.

    Args:
        name: under which it stands in its module, so that it can be sent to other processes.
        module: the name of that.
        settings: the dataclass.
        base: what sections have in common.
    """
    hints = get_type_hints(settings)
    keys: dict[str, Any] = {each.name: _key(settings, each, hints[each.name]) for each in fields(settings)}
    return create_model(name, __base__=base, __module__=module, __doc__=settings.__doc__, **keys)


def _key(settings: type, each: DataclassField[Any], hint: Any) -> tuple[Any, Any]:
    kind: Any = Annotated[_STRICT.get(hint, hint), rule_of(settings, each.name)]
    return (kind | None, None) if is_fitted(each) else (kind, each.default)
