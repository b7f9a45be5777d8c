"""What columns mean, from the catalogue of figures."""

from __future__ import annotations

from collections.abc import Iterable

from slamgauge.compare.report.page_elements import Head
from slamgauge.compare.report.page_elements import Table as PageTable
from slamgauge.compare.scoring.catalogue import CATALOGUE, columns
from slamgauge.compare.scoring.metric import Table

HELP = {each.key: each.help for each in CATALOGUE}
ESTIMATOR = Head("estimator", "who made the estimate", words=True)
KIND = Head(
    "kind",
    "filtered: a pose knows the past alone; smoothed: it knows all measurements. They are never ranked",
    words=True,
)
TERMS = {
    "run": (
        ("causal optimum", "the best that can be known of a pose from what came before (causal), with the true noise"),
        ("hindsight optimum", "the best that all measurements together tell (batch)"),
        (
            "3-sigma ellipse",
            "where the estimate says that the place is, with 98.9 % in the plane, if its sigma is right",
        ),
    ),
    "study": (
        ("\u00b1", "half the width of the 95 % interval of the mean over runs"),
        ("band", "where the mean of consistent estimates would be, at the level that stands beside it"),
    ),
}


def figure_heads(table: Table, *, bounded: bool = False) -> list[Head]:
    """The columns of figures in a table, from the left; with those of bounds if it is `bounded`."""
    return [Head(title, HELP[key]) for title, key, _ in columns(table, bounded=bounded)]


def glossary(terms: Iterable[tuple[str, str]], tables: Iterable[PageTable]) -> list[tuple[str, str]]:
    """Terms, and the columns of tables: each once, and nothing of a table without rows, which is not shown."""
    shown = [head for table in tables if table.rows for head in table.columns]
    return [*dict.fromkeys([*terms, *((head.title, head.help) for head in shown if head.help)])]
