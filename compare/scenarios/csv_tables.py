"""CSV files that a scenario names: their content becomes part of the scenario.

Workers receive the content with the scenario, and the digest of a study covers it. A scenario's key has the file's
name, relative to the folder of the scenario file. The first line is a header; each key accepts its own columns.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Annotated

from pydantic import BeforeValidator, ValidationInfo

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.section import Section, invalid
from slamgauge.compare.storage.csv_folder import from_triangles
from slamgauge.compare.storage.text_lines import csv_lines, read_whole, rows_below
from slamgauge.errors import UserError
from slamgauge.validation import as_covariances

FOLDER = "folder"  # key of the validation context: folder of the files that a scenario names

Header = tuple[str, ...]


class TableText(Section, frozen=True):
    """A CSV file: its `name` in the scenario, and its `text`."""

    name: str
    text: str

    def rows(self, *headers: Header) -> Float:
        """Return the numbers (n, columns) below the header, which is one of `headers`.

        Raises:
            PydanticCustomError: another header, or a line that does not fit it.
        """
        return _rows(self, headers)


@lru_cache(maxsize=16)  # every run of a study needs the rows
def _rows(table: TableText, headers: tuple[Header, ...]) -> Float:
    try:
        rows = rows_below(table.name, csv_lines(table.name, table.text), *headers)
    except UserError as error:
        raise invalid(str(error)) from None
    rows.setflags(write=False)
    return rows


@lru_cache(maxsize=16)
def covariances(table: TableText, header: Header, dim: int, *, is_definite: bool = False) -> Float:
    """Return covariances (n, dim, dim), whose upper triangles are the last columns of a file.

    Raises:
        PydanticCustomError: as `TableText.rows`, or a row has no covariance.
    """
    triangles = table.rows(header)[:, -(dim * (dim + 1) // 2) :]
    try:
        covs = as_covariances("row", from_triangles(triangles, dim), (len(triangles), dim, dim), definite=is_definite)
    except UserError as error:
        raise invalid(f"{table.name}: {error}") from None
    covs.setflags(write=False)
    return covs


def _read(value: object, info: ValidationInfo) -> object:
    if not isinstance(value, str):
        return value
    folder: Path = (info.context or {}).get(FOLDER, Path())
    try:
        return TableText(name=value, text="\n".join(read_whole(folder / value).rstrip().splitlines()))
    except UserError as error:
        raise invalid(str(error)) from None


Table = Annotated[TableText, BeforeValidator(_read)]
