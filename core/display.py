"""Display of results: numbers with nouns, tables in notebooks."""

from __future__ import annotations

import html
from collections.abc import Sequence

LONGEST_FIGURE = 24  # characters; longer texts may wrap


def html_table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a table of HTML with escaped texts: figures do not wrap, and a wide table scrolls."""
    titles = "".join(f"<th>{html.escape(title)}</th>" for title in head)
    lines = "".join(f"<tr>{''.join(_cell(str(text)) for text in row)}</tr>" for row in rows)
    table = f"<table><thead><tr>{titles}</tr></thead><tbody>{lines}</tbody></table>"
    return f'<div style="overflow-x: auto">{table}</div>'


def _cell(text: str) -> str:
    kept = "" if len(text) > LONGEST_FIGURE else ' style="white-space: nowrap"'
    return f"<td{kept}>{html.escape(text)}</td>"


def counted(count: int, what: str) -> str:
    """Return `1 landmark`, `2 landmarks`."""
    return f"{count} {what}{'s' * (count != 1)}"
