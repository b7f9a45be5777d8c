"""Write the tables of metrics in glossary.md, from the catalogue of metrics.

    python docs/make_tables.py

A table follows a line `<!-- table NAME -->` and ends before the next empty line.
"""

from __future__ import annotations

import re
from pathlib import Path

from slamgauge.compare.scoring.catalogue import CATALOGUE

DOCS = Path(__file__).parent
TABLES = ("run", "study", "sweep")


def columns() -> str:
    """Return the columns of the printed tables."""
    lines = ["| column | tables | in files | meaning |", "|---|---|---|---|"]
    for each in CATALOGUE:
        if each.column is not None:
            column = each.column
            where = ", ".join(name for name in TABLES if getattr(column, name) is not None)
            lines.append(f"| *{column.name or column.title}* | {where} | `{each.key}` | {each.help} |")
    return "\n".join(lines)


def keys(file: str) -> str:
    """Return the figures of an estimator in metrics.json or summary.json."""
    chosen = [
        each for each in CATALOGUE if (each.measure is not None if file == "metrics" else each.over_runs is not None)
    ]
    rows = [f"| `{each.key}` | {each.unit} | {each.help} |" for each in chosen]
    return "\n".join(["| key | unit | meaning |", "|---|---|---|", *rows])


def filled(text: str) -> str:
    """Return a page with all its tables."""
    made = {"columns": columns(), "metrics": keys("metrics"), "summary": keys("summary")}
    marked = re.compile(r"(<!-- table (\w+) -->\n)(?:\|.*\n)*")
    return marked.sub(lambda found: f"{found[1]}{made[found[2]]}\n", text)


if __name__ == "__main__":
    page = DOCS / "glossary.md"
    page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")
