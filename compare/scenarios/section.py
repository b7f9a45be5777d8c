"""Sections of scenario files: number types, the base class, and sections made from a filter's settings."""

from __future__ import annotations

from dataclasses import Field as DataclassField
from dataclasses import fields
from typing import Annotated, Any, get_type_hints

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, create_model
from pydantic_core import PydanticCustomError

from slamgauge.ekf.setting_rules import is_fitted, mistake_of
from slamgauge.validation import LARGEST


def invalid(message: str, kind: str = "invalid") -> PydanticCustomError:
    """Return the error of a validator; `scenario` prints the message after the key."""
    return PydanticCustomError(kind, "{message}", {"message": message})  # pyrefly: ignore[bad-argument-type]


def _limited(number: float) -> float:
    if abs(number) > LARGEST:
        raise invalid(f"must be at most {LARGEST:g} in size, not {number:g}")
    return number


Number = Annotated[float, Field(strict=True), AfterValidator(_limited)]  # strict: neither "1" nor true is a number
Whole = Annotated[int, Field(strict=True)]
NonNegative = Annotated[Number, Field(ge=0)]
Positive = Annotated[Number, Field(gt=0)]
Probability = Annotated[Number, Field(ge=0, le=1)]


class Section(BaseModel):
    """A table of the file: immutable, no unknown keys, finite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def within(least: float, most: float, unit: str) -> AfterValidator:
    """Return a validator of numbers whose size is between two limits; 0 and None are valid."""

    def check(number: float | None) -> float | None:
        if number and not least <= abs(number) <= most:
            raise invalid(f"must be from {least:g} to {most:g} {unit} in size, not {number:g}")
        return number

    return AfterValidator(check)


def rule_of(settings: type, key: str) -> AfterValidator:
    """Return a validator that applies the rule of one field of a settings dataclass to a key of a file."""
    field = next(each for each in fields(settings) if each.name == key)

    def check(value: object) -> object:
        mistake = "" if value is None else mistake_of(field, settings, value)
        if mistake:
            raise invalid(mistake)
        return value

    return AfterValidator(check)


def section_of(name: str, module: str, settings: type) -> type[Section]:
    """Return a section with the fields, defaults and rules of a settings dataclass.

    A field whose default depends on the sensor's range is None in the section. `name` and `module` are where the
    class is defined, so that it can be pickled.
    """
    hints = get_type_hints(settings)
    keys: dict[str, Any] = {each.name: _key(settings, each, hints[each.name]) for each in fields(settings)}
    return create_model(name, __base__=Section, __module__=module, __doc__=settings.__doc__, **keys)


def _key(settings: type, each: DataclassField[Any], hint: Any) -> tuple[Any, Any]:
    strict = {float: Number, int: Whole}.get(hint, hint)
    kind: Any = Annotated[strict, rule_of(settings, each.name)]
    return (kind | None, None) if is_fitted(each) else (kind, each.default)
