"""Writers of tables for papers and other programs: CSV, LaTeX with booktabs, Markdown."""

from __future__ import annotations

import html
from io import StringIO

from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.table import Table
from slamgauge.compare.storage.files import write_csv

ENDS = ("mean", "low", "high")
LATEX = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"} | {
    sign: f"\\{sign}" for sign in "&%$#_{}"
}


def csv_text(table: Table, *, intervals: bool) -> str:
    """Return full precision; columns of metrics are KEY and, with intervals, KEY_low and KEY_high."""
    ends = ENDS if intervals else ENDS[:1]
    names: list[str] = []
    for head in table.heads:
        found = [head.key if end == "mean" else f"{head.key}_{end}" for end in ends]
        names += found if head.key else [head.title]
    rows: list[list[object]] = [[*names]]
    for row in table.rows:
        cells: list[object] = []
        for head, cell in zip(table.heads, row, strict=True):
            value = cell.value
            if head.key:
                cells += [getattr(value, end, None) if isinstance(value, Interval) else None for end in ends]
            else:
                cells.append(cell.text if value is None else value)
        rows.append(cells)
    out = StringIO()
    write_csv(out, rows)
    return out.getvalue()


def markdown_text(table: Table) -> str:
    """Return a table of Markdown."""
    texts = [[head.title for head in table.heads], *([cell.text for cell in row] for row in table.rows)]
    head, *body = [[html.escape(text, quote=False).replace("|", r"\|") for text in row] for row in texts]
    rule = ["---" if each.words else "---:" for each in table.heads]
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, rule, *body)) + "\n"


def latex_text(table: Table, label: str, comment: str) -> str:
    """Return a floating table with the caption of `table`; `comment` is a line on top."""
    texts = [[head.title for head in table.heads], *([cell.text for cell in row] for row in table.rows)]
    head, *body = [" & ".join(escaped(text).replace("±", r"$\pm$") for text in row) + r" \\" for row in texts]
    lines = [
        f"% {comment}",
        r"% needs \usepackage{booktabs}",
        r"\begin{table}",
        r"  \centering",
        rf"  \caption{{{escaped(table.caption)}}}",
        rf"  \label{{tab:{label}}}",
        rf"  \begin{{tabular}}{{{''.join('l' if each.words else 'r' for each in table.heads)}}}",
        r"    \toprule",
        f"    {head}",
        r"    \midrule",
        *(f"    {row}" for row in body),
        r"    \bottomrule",
        r"  \end{tabular}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def escaped(text: str) -> str:
    """Escape a text for LaTeX."""
    return "".join(LATEX.get(sign, sign) for sign in text)
