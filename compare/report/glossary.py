"""Explanations of columns, from the catalogue of metrics."""

from __future__ import annotations

from collections.abc import Iterable

from slamgauge.compare.report.page_elements import Head
from slamgauge.compare.report.page_elements import Table as PageTable
from slamgauge.compare.scoring.catalogue import CATALOGUE, FULL_NAMES, columns
from slamgauge.compare.scoring.metric import Table

HELP = {each.key: each.help for each in CATALOGUE}
ESTIMATOR = Head("estimator", "name of the estimator", words=True)
KIND = Head(
    "kind",
    "filtered: poses use only measurements up to their step; smoothed: they use all; the two are not compared",
    words=True,
)
TERMS = {
    "run": (
        ("causal optimum", "best estimate from the measurements up to each step, with the true noise (causal)"),
        ("hindsight optimum", "best estimate from all measurements (batch)"),
        (
            "3-sigma ellipse",
            "region that contains the true position with probability 98.9 % if the covariance is right",
        ),
    ),
    "study": (
        ("\u00b1", "half the width of the 95 % interval of the mean over runs"),
        ("band", "interval of the mean for consistent estimates, at the stated level"),
    ),
}


def figure_heads(table: Table, *, bounded: bool = False) -> list[Head]:
    """Return the metric columns of a table; with the columns of bounds if `bounded`."""
    return [Head(FULL_NAMES[title], HELP[key]) for title, key, _ in columns(table, bounded=bounded)]


def glossary(terms: Iterable[tuple[str, str]], tables: Iterable[PageTable]) -> list[tuple[str, str]]:
    """Return terms and columns of tables with rows, each once."""
    shown = [head for table in tables if table.rows for head in table.columns]
    return [*dict.fromkeys([*terms, *((head.title, head.help) for head in shown if head.help)])]
