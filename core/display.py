"""Display of results: numbers with nouns, tables in notebooks."""

from __future__ import annotations

import html
from collections.abc import Sequence


def html_table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a table of HTML with escaped texts, which do not wrap: a wide table scrolls."""
    titles = "".join(f"<th>{html.escape(title)}</th>" for title in head)
    cells = ["".join(f"<td>{html.escape(str(text))}</td>" for text in row) for row in rows]
    lines = "".join(f"<tr>{each}</tr>" for each in cells)
    table = f"<table><thead><tr>{titles}</tr></thead><tbody>{lines}</tbody></table>"
    return f'<div style="overflow-x: auto; white-space: nowrap">{table}</div>'


def counted(count: int, what: str) -> str:
    """Return `1 landmark`, `2 landmarks`."""
    return f"{count} {what}{'s' * (count != 1)}"
