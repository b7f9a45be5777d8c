"""How values show themselves: a line for the prompt, a table for notebooks, a data frame where pandas is installed."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

from slamgauge.errors import UserError


def html_table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table whose texts are shown as they are."""
    titles = "".join(f"<th>{html.escape(title)}</th>" for title in head)
    lines = "".join(f"<tr>{''.join(f'<td>{html.escape(str(text))}</td>' for text in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{titles}</tr></thead><tbody>{lines}</tbody></table>"


def fact_table(facts: Mapping[str, object]) -> str:
    """A line for each fact."""
    return html_table(("", ""), [*facts.items()])


def counted(count: int, what: str) -> str:
    """`1 landmark`, `2 landmarks`."""
    return f"{count} {what}{'s' * (count != 1)}"


def data_frame(columns: Mapping[str, Any], index: list[str] | None = None) -> Any:
    """A `pandas.DataFrame`.

    Raises:
        UserError: pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise UserError("to_frame: needs pandas; pip install pandas") from None
    return pd.DataFrame(dict(columns), index=index)
