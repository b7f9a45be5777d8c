"""Layout of pages: important columns stay, sentences continue on further lines, hidden columns are named; cells."""

from __future__ import annotations

from collections.abc import Collection

import pytest

from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.table import Head, Table, cell, interval_cell
from slamgauge.compare.scoring.text_page import Page, Tone

ROWS = [["estimator", "ATE [m]", "NEES"], ["ekf", "1.25", "3.1"], ["mine", "0.5", "failed"]]


def table(rows: list[list[str]], words: Collection[int] = (0,), wraps: int | None = None, **names: str) -> Table:
    """Return a table; the first row has the titles, `names` are full names by title."""
    heads = [
        Head(title, names.get(title, ""), words=place in words, wraps=place == wraps)
        for place, title in enumerate(rows[0])
    ]
    return Table.of(heads, rows[1:])


FIGURES = table(ROWS)
CLAIMS = [["no", "claim", "verdict"], ["1", "a gate that is too small maps more than there is", "holds"]]
SENTENCES = table(CLAIMS, range(3), 1)


def toned(text: str, tone: Tone) -> str:
    return text if tone == "plain" else f"<{tone}>{text}</{tone}>"


def test_a_page_without_a_width_is_complete():
    page = Page((FIGURES, "", "a line that is longer than the table under which it stands"))
    assert str(page).splitlines() == [
        "estimator  ATE [m]    NEES",
        "ekf           1.25     3.1",
        "mine           0.5  failed",
        "",
        "a line that is longer than the table under which it stands",
    ]


def test_columns_from_the_right_are_hidden_and_named():
    lines = Page((table(ROWS, NEES="pose NEES"), "further words")).text(24).splitlines()
    assert lines[:3] == ["estimator  ATE [m]", "ekf           1.25", "mine           0.5"]
    assert " ".join(line.strip() for line in lines[3:-1]) == "Hidden columns (show with --wide): pose NEES"
    assert lines[-1] == "further words"
    assert max(map(len, lines)) <= 24
    without_figures = Page((table([[*ROWS[0], "NIS"], *([*row, "-"] for row in ROWS[1:])]),)).text(24)
    assert without_figures.splitlines()[3:] == ["Hidden columns (show", "  with --wide): NEES"]


def test_heads_are_full_names_if_the_table_then_fits():
    page = Page((table(ROWS, NEES="pose NEES"),))
    heads = {width: page.text(width).splitlines()[0] for width in (None, 29, 28)}
    assert [head.endswith("  pose NEES") for head in heads.values()] == [True, True, False]
    assert heads[28] == "estimator  ATE [m]    NEES"
    assert "<th>pose NEES</th>" in page.html()


def test_a_column_that_is_wider_than_its_title_is_hidden_too():
    grid = table([["rung", "adds", "for"], ["causal", "0.5", "for knowing only the past"]], (0, 2), 2)
    lines = Page((grid,)).text(30).splitlines()
    assert lines[:2] == ["rung    adds", "causal   0.5"]
    assert max(map(len, lines)) <= 30
    assert Page((grid,)).text(36).splitlines() == [
        "rung    adds  for",
        "causal   0.5  for knowing only the",
        "              past",
    ]


def test_sentences_continue_on_further_lines():
    lines = Page((SENTENCES,)).text(40).splitlines()
    assert lines == [
        "no  claim                     verdict",
        "1   a gate that is too small  holds",
        "    maps more than there is",
    ]


def test_no_line_ends_in_blanks():
    grid = table([["noise", "verdict", "more"], ["forward", "any value below that of the log", "x" * 40]], range(3), 1)
    lines = Page((grid,)).text(40).splitlines()
    assert lines[0] == "noise    verdict"
    assert [line.rstrip() for line in lines] == lines


def test_long_names_lose_their_middle_if_the_width_is_limited():
    grid = table([["estimator", "ATE [m]"], ["a_name_of_many_characters/and_more:of_them", "1.0"], ["b", "2.0"]])
    assert Page((grid,)).text(40).splitlines()[1] == "a_name_of_ma...more:of_them      1.0"
    assert "many_characters" in str(Page((grid,)))


def test_tones_do_not_change_the_layout():
    assert Page((SENTENCES,)).text(40, toned).splitlines()[1] == "1   a gate that is too small  <good>holds</good>"
    lines = Page((FIGURES,)).text(None, toned).splitlines()
    assert (lines[0], lines[2]) == ("<head>estimator  ATE [m]    NEES</head>", "mine           0.5  <bad>failed</bad>")


def test_notebooks_show_tables_and_escape_names():
    shown = Page((table([["estimator"], ["<b>"]]), "", "a & b")).html()
    assert shown.splitlines() == [
        '<div style="overflow-x: auto"><table><thead><tr><th>estimator</th></tr></thead>'
        '<tbody><tr><td style="white-space: nowrap">&lt;b&gt;</td></tr></tbody></table></div>',
        "",
        "<p>a &amp; b</p>",
    ]


@pytest.mark.parametrize(
    ("value", "form", "shown"),
    [
        (None, "{:.2f}", "-"),
        (1.234, "{:.2f}", "1.23"),
        (-12345678.0, "{:.2f}", "-12345678.00"),
        (5.4e299, "{:.2f}", "5.4e+299"),
        (-1e9, "{:.2f}", "-1e+09"),
        (-0.001, "{:.0%}", "0%"),  # what is rounded to zero has no minus
        (-0.001, "{:+.2f}", "+0.00"),
        (-0.001, "{:.3f}", "-0.001"),
        (Interval(5.4e299, 1.4e299, 9.4e299), "{:.2f}", "5.4e+299 ± 4e+299"),
        (Interval(1.0, 0.5, 1.5), "{:+.2f}", "+1.00 ± 0.50"),
        (Interval(7e12, None, None), "{:.2f}", "7e+12"),
    ],
)
def test_cells(value: float | Interval | None, form: str, shown: str):
    assert (interval_cell if isinstance(value, Interval) else cell)(value, form) == shown  # pyrefly: ignore[bad-argument-type]
