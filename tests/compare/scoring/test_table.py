"""Layout of pages: important columns stay, sentences continue on further lines, hidden columns are named; cells."""

from __future__ import annotations

from collections.abc import Collection

import pytest

from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.table import Head, Page, Table, cell

ROWS = [["estimator", "ATE [m]", "NEES"], ["ekf", "1.25", "3.1"], ["mine", "0.5", "failed"]]
SHOWN = ["estimator  ATE [m]    NEES", "ekf           1.25     3.1", "mine           0.5  failed"]
CLAIMS = [["no", "claim", "verdict"], ["1", "a gate that is too small maps more than there is", "holds"]]
WRAPPED = [
    "no  claim                     verdict",
    "1   a gate that is too small  holds",
    "    maps more than there is",
]
NOISE = [["noise", "verdict", "more"], ["forward", "any value below that of the log", "x" * 40]]
NAMES = [["estimator", "ATE [m]"], ["a_name_of_many_characters/and_more:of_them", "1.0"], ["b", "2.0"]]


def table(rows: list[list[str]], words: Collection[int] = (0,), wraps: int | None = None, **names: str) -> Table:
    """Return a table; the first row has the titles, `names` are full names by title."""
    places = enumerate(rows[0])
    heads = [Head(title, names.get(title, ""), words=n in words, wraps=n == wraps) for n, title in places]
    return Table.of(heads, rows[1:])


def test_a_page_without_a_width_is_complete():
    line = "a line that is longer than the table under which it stands"
    assert str(Page((table(ROWS), "", line))).splitlines() == [*SHOWN, "", line]


@pytest.mark.parametrize(
    ("grid", "width", "lines"),
    [
        (table(ROWS, NEES="pose NEES"), 29, ["estimator  ATE [m]  pose NEES"]),  # full names if the table then fits
        (table(ROWS, NEES="pose NEES"), 28, ["estimator  ATE [m]    NEES"]),
        (table(ROWS), 24, [*(line[:18] for line in SHOWN), "Hidden columns (show", "  with --wide): NEES"]),
        (table(CLAIMS, range(3), 1), 40, WRAPPED),
        (table(NOISE, range(3), 1), 40, ["noise    verdict"]),
        (table(NAMES), 40, ["estimator                    ATE [m]", "a_name_of_ma...more:of_them      1.0"]),
    ],
)
def test_tables_within_a_width(grid: Table, width: int, lines: list[str]):
    """Columns from the right are hidden and named, sentences continue on further lines, long names are shortened."""
    found = Page((grid, "further words")).text(width).splitlines()
    assert found[: len(lines)] == lines
    assert found[-1] == "further words"
    assert max(map(len, found)) <= width
    assert [line.rstrip() for line in found] == found


def test_columns_without_figures_are_not_named_and_long_names_stay_without_a_width():
    grid = table([[*ROWS[0], "NIS"], *([*row, "-"] for row in ROWS[1:])])
    assert Page((grid,)).text(24).splitlines()[3:] == ["Hidden columns (show", "  with --wide): NEES"]
    assert "many_characters" in str(Page((table(NAMES),)))
    assert Page((table(CLAIMS, range(3), 1),)).text(40).splitlines()[1].endswith("small  holds")


def test_notebooks_show_tables_with_full_names_and_escape_texts():
    shown = Page((table([["estimator"], ["<b>"]], estimator="name"), "", "a & b")).html()
    assert shown.splitlines() == [
        '<div style="overflow-x: auto; white-space: nowrap"><table><thead><tr><th>name</th></tr></thead>'
        "<tbody><tr><td>&lt;b&gt;</td></tr></tbody></table></div>",
        "",
        "<p>a &amp; b</p>",
    ]


@pytest.mark.parametrize(
    ("value", "form", "shown"),
    [
        (None, "{:.2f}", "-"),
        (-12345678.0, "{:.2f}", "-12345678.00"),
        (5.4e299, "{:.2f}", "5.4e+299"),
        (-0.001, "{:.0%}", "0%"),  # a zero by rounding has no minus
        (-0.001, "{:.3f}", "-0.001"),
        (Interval(5.4e299, 1.4e299, 9.4e299), "{:.2f}", "5.4e+299 ± 4e+299"),
        (Interval(1.0, 0.5, 1.5), "{:+.2f}", "+1.00 ± 0.50"),
        (Interval(7e12, None, None), "{:.2f}", "7e+12"),
    ],
)
def test_cells(value: float | Interval | None, form: str, shown: str):
    assert cell(value, form) == shown
