"""CSV files that a scenario names: their content becomes part of it, so that it travels and tells studies apart.

A scenario's key holds the file's name, relative to the folder of the scenario file. The first line is a header; which
columns there are is the business of the key.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Annotated

from pydantic import BeforeValidator, ValidationInfo
from pydantic_core import PydanticCustomError

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.section import Section
from slamgauge.compare.storage.covariance_columns import from_triangles
from slamgauge.compare.storage.csv_folder import parse_rows, read_lines
from slamgauge.errors import UserError
from slamgauge.validation import as_covariances

FOLDER = "folder"  # in the context of a validation: where the files are that a scenario names

Header = tuple[str, ...]


class TableText(Section):
    """A CSV file: its `name` as the scenario has it, and its `text`."""

    name: str
    text: str

    def rows(self, *headers: Header) -> Float:
        """The numbers (n, columns) below the header, which is one of `headers`.

        Raises:
            PydanticCustomError: another header, or a line that does not fit it.
        """
        try:
            return _rows(self.name, self.text, headers)
        except UserError as error:
            raise PydanticCustomError("table", "{mistake}", {"mistake": str(error)}) from None


@lru_cache(maxsize=16)  # every run of a study asks again
def _rows(name: str, text: str, headers: tuple[Header, ...]) -> Float:
    rows = parse_rows(name, text.splitlines(), *headers)
    rows.setflags(write=False)
    return rows


def covariances(table: TableText, header: Header, dim: int, *, is_definite: bool = False) -> Float:
    """Covariances (n, dim, dim), the upper triangles of which are the last columns of a file.

    Raises:
        PydanticCustomError: as `TableText.rows`, or a row holds no covariance.
    """
    try:
        return _covariances(table.name, table.text, header, dim, is_definite)
    except UserError as error:
        raise PydanticCustomError("table", "{mistake}", {"mistake": f"{table.name}: {error}"}) from None


@lru_cache(maxsize=16)
def _covariances(name: str, text: str, header: Header, dim: int, is_definite: bool) -> Float:
    triangles = _rows(name, text, (header,))[:, -(dim * (dim + 1) // 2) :]
    covs = as_covariances("row", from_triangles(triangles, dim), (len(triangles), dim, dim), definite=is_definite)
    covs.setflags(write=False)
    return covs


def _read(value: object, info: ValidationInfo) -> object:
    if not isinstance(value, str):
        return value
    folder: Path = (info.context or {}).get(FOLDER, Path())
    try:
        return TableText(name=value, text="\n".join(read_lines(folder / value)))
    except UserError as error:
        raise PydanticCustomError("file", "{mistake}", {"mistake": str(error)}) from None


Table = Annotated[TableText, BeforeValidator(_read)]
