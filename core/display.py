"""Display of results: numbers with nouns, printed tables in notebooks."""

from __future__ import annotations

import html


def preformatted(text: str) -> str:
    """Return a text as HTML, with aligned columns; long lines scroll."""
    return f'<pre style="white-space: pre; overflow-x: auto">{html.escape(text)}</pre>'


def counted(count: int, what: str) -> str:
    """Return `1 landmark`, `2 landmarks`."""
    return f"{count} {what}{'s' * (count != 1)}"
