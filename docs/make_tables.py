"""Write the table of metrics in glossary.md, from the catalogue of metrics.

    python docs/make_tables.py

A table follows a line `<!-- table NAME -->` and ends before the next empty line.
"""

from __future__ import annotations

import re
from pathlib import Path

from slamgauge.compare.scoring.catalogue import BY_KEY

PAGE = Path(__file__).parent / "glossary.md"
TABLES = ("run", "study", "sweep")


def metrics() -> str:
    """Return all metrics with their columns in printed tables and the files that contain them."""
    lines = ["| column | tables | key | files | meaning |", "|---|---|---|---|---|"]
    for each in sorted(BY_KEY.values(), key=lambda each: each.measure is None):
        column, where = "", ""
        if each.column is not None:
            column = f"*{each.column.name or each.column.title}*"
            where = ", ".join(name for name in TABLES if getattr(each.column, name) is not None)
        files = ", ".join(
            name for name, made in (("metrics", each.measure), ("summary", each.over_runs)) if made is not None
        )
        lines.append(f"| {column} | {where} | `{each.key}` | {files} | {each.help} |")
    return "\n".join(lines)


def filled(text: str) -> str:
    """Return the page with its table."""
    marked = re.compile(r"(<!-- table metrics -->\n)(?:\|.*\n)*")
    return marked.sub(lambda found: f"{found[1]}{metrics()}\n", text)


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
