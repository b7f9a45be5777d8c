"""Texts in CSV files are no formulas of a spreadsheet, and are read back as they were."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamgauge.compare.storage.csv_cells import read_csv, write_csv
from slamgauge.errors import UserError


@pytest.mark.parametrize(
    ("cell", "written"),
    [
        ('=HYPERLINK("http://a")', '"\'=HYPERLINK(""http://a"")"'),
        ("+1+1", "'+1+1"),
        ("-x", "'-x"),
        ("@SUM(1)", "'@SUM(1)"),
        ("'=x", "''=x"),
        ("-1.5e-3", "-1.5e-3"),
        ("'quoted'", "'quoted'"),
        ("a=b", "a=b"),
    ],
)
def test_formulas_have_an_apostrophe_in_front(tmp_path: Path, cell: str, written: str):
    path = tmp_path / "table.csv"
    with path.open("w", newline="") as file:
        write_csv(file, [["name", "value"], [cell, -0.5]])
    assert path.read_text() == f"name,value\n{written},-0.5\n"
    assert read_csv(path) == [{"name": cell, "value": "-0.5"}]


def test_a_missing_file_is_an_error_of_one_line(tmp_path: Path):
    with pytest.raises(UserError, match="cannot be read"):
        read_csv(tmp_path / "missing.csv")
