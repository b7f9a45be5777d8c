"""Sections of scenario files: number types, the base class, sections of a filter's settings, and CSV files.

The content of a CSV file that a scenario names becomes part of the scenario: workers receive it with the scenario, and
the digest of a study covers it. A scenario's key has the file's name, relative to the folder of the scenario file. The
first line is a header; each key accepts its own columns.
"""

from __future__ import annotations

from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo, create_model
from pydantic_core import PydanticCustomError

from slamgauge.arrays import Float
from slamgauge.compare.storage.csv_folder import from_triangles
from slamgauge.compare.storage.text_lines import read_whole, rows_below
from slamgauge.ekf.setting_rules import is_fitted, mistake_of
from slamgauge.errors import UserError
from slamgauge.validation import LARGEST, as_covariances

Header = tuple[str, ...]
FOLDER = "folder"  # key of the validation context: folder of the files that a scenario names


def invalid(message: str, key: str = "") -> PydanticCustomError:
    """Return the error of a validator, of one `key` of a section; validators may raise a `UserError`, too."""
    return PydanticCustomError("invalid", "{message}", {"message": message, "key": key})  # pyrefly: ignore[bad-argument-type]


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
    keys: dict[str, Any] = {}
    hints = get_type_hints(settings)
    for each in fields(settings):
        strict = {float: Number, int: Whole}.get(hints[each.name], hints[each.name])
        kind: Any = Annotated[strict, rule_of(settings, each.name)]
        keys[each.name] = (kind | None, None) if is_fitted(each) else (kind, each.default)
    return create_model(name, __base__=Section, __module__=module, __doc__=settings.__doc__, **keys)


class TableText(Section, frozen=True):
    """A CSV file: its `name` in the scenario, and its `text`."""

    name: str
    text: str

    def rows(self, *headers: Header) -> Float:
        """Return the numbers (n, columns) below the header, which is one of `headers`.

        Raises:
            UserError: another header, or a line that does not fit it.
        """
        return _rows(self, headers)


@lru_cache(maxsize=16)  # every run of a study needs the rows
def _rows(table: TableText, headers: tuple[Header, ...]) -> Float:
    rows = rows_below(table.name, table.text, *headers)
    rows.setflags(write=False)
    return rows


@lru_cache(maxsize=16)
def covariances(table: TableText, header: Header, dim: int, *, is_definite: bool = False) -> Float:
    """Return covariances (n, dim, dim), whose upper triangles are the last columns of a file.

    Raises:
        UserError: as `TableText.rows`, or a row has no covariance.
    """
    triangles = table.rows(header)[:, -(dim * (dim + 1) // 2) :]
    try:
        covs = as_covariances("row", from_triangles(triangles), (len(triangles), dim, dim), definite=is_definite)
    except UserError as error:
        raise UserError(f"{table.name}: {error}") from None
    covs.setflags(write=False)
    return covs


def _read(value: object, info: ValidationInfo) -> object:
    if not isinstance(value, str):
        return value
    folder: Path = (info.context or {}).get(FOLDER, Path())
    return TableText(name=value, text="\n".join(read_whole(folder / value).rstrip().splitlines()))


Table = Annotated[TableText, BeforeValidator(_read)]
