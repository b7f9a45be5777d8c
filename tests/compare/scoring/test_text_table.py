"""Cells of tables."""

from __future__ import annotations

import pytest

from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.text_table import cell, interval_cell


@pytest.mark.parametrize(
    ("value", "shown"),
    [(None, "-"), (1.234, "1.23"), (-12345678.0, "-12345678.00"), (5.4e299, "5.4e+299"), (-1e9, "-1e+09")],
)
def test_vast_figures_have_an_exponent(value: float | None, shown: str):
    assert cell(value, "{:.2f}") == shown


@pytest.mark.parametrize(("form", "shown"), [("{:.0%}", "0%"), ("{:+.2f}", "+0.00"), ("{:.3f}", "-0.001")])
def test_what_is_rounded_to_nothing_has_no_minus(form: str, shown: str):
    assert cell(-0.001, form) == shown


def test_intervals_of_vast_figures_do_not_fill_the_screen():
    assert interval_cell(Interval(5.4e299, 1.4e299, 9.4e299), "{:.2f}") == "5.4e+299 ± 4e+299"
    assert interval_cell(Interval(1.0, 0.5, 1.5), "{:+.2f}") == "+1.00 ± +0.50"
    assert interval_cell(Interval(7e12, None, None), "{:.2f}") == "7e+12"
