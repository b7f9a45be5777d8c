"""The table of a study for papers and other programs: CSV, LaTeX with booktabs, Markdown."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any, Literal

from slamgauge.compare.scoring.catalogue import CATALOGUE, columns
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.text_table import cell, interval_cell
from slamgauge.compare.storage.csv_cells import write_csv
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import SUMMARY
from slamgauge.compare.storage.safe_names import shown
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

Form = Literal["csv", "latex", "markdown"]
KEY_COLUMNS = 4  # default: the first columns of the printed table
HELP = {each.key: each.help for each in CATALOGUE}
LATEX = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"} | {
    sign: f"\\{sign}" for sign in "&%$#_{}"
}


@dataclass(frozen=True)
class StudyTable:
    """Means over runs with 95 % intervals, read from summary.json.

    Attributes:
        content: content of summary.json.
        keys: figures of the catalogue, one for each column.
        estimators: one for each row.
        intervals: whether intervals are written next to means.
    """

    content: Mapping[str, Any]
    keys: tuple[str, ...]
    estimators: tuple[str, ...]
    intervals: bool = True

    def text(self, form: Form) -> str:
        """Return the table in one of the forms."""
        return {"csv": self._csv, "latex": self._latex, "markdown": self._markdown}[form]()

    def caption(self) -> str:
        """Return a description of the table in a sentence or two."""
        seed, runs = self.content["seed"], self.content["runs"]
        what = "means with 95 % intervals" if self.intervals else "means"
        meanings = "; ".join(f"{_title(key)}: {HELP[key]}" for key in self.keys)
        return f"{self.content['scenario']}, {runs} runs (seed {seed}), {what}. {meanings}."

    def _figures(self, estimator: str) -> list[Interval | None]:
        entry = self.content["estimators"][estimator]
        return [None if entry.get(key) is None else Interval(**entry[key]) for key in self.keys]

    def _csv(self) -> str:
        """Return full precision, with columns KEY, KEY_low and KEY_high."""
        ends = ("mean", "low", "high") if self.intervals else ("mean",)
        out = StringIO()
        names = [key if end == "mean" else f"{key}_{end}" for key in self.keys for end in ends]
        rows: list[list[object]] = [["estimator", "runs", *names]]
        for name in self.estimators:
            figures = [getattr(each, end, None) for each in self._figures(name) for end in ends]
            rows.append([shown(name), self.content["estimators"][name]["runs"], *figures])
        write_csv(out, rows)
        return out.getvalue()

    def _rows(self) -> list[list[str]]:
        forms = {key: form for _, key, form in columns("study", bounded=True)}
        rows = [["estimator", "runs", *map(_title, self.keys)]]
        for name in self.estimators:
            cells = [
                interval_cell(each, form) if self.intervals else cell(None if each is None else each.mean, form)
                for each, form in zip(self._figures(name), (forms.get(key, "{:.4g}") for key in self.keys), strict=True)
            ]
            rows.append([shown(name), str(self.content["estimators"][name]["runs"]), *cells])
        return rows

    def _markdown(self) -> str:
        head, *body = [[html.escape(text, quote=False).replace("|", r"\|") for text in row] for row in self._rows()]
        rule = ["---", *("---:" for _ in head[1:])]
        return "\n".join(f"| {' | '.join(row)} |" for row in (head, rule, *body)) + "\n"

    def _latex(self) -> str:
        head, *body = [
            " & ".join(latex_text(text).replace("±", r"$\pm$") for text in row) + r" \\" for row in self._rows()
        ]
        label = re.sub(r"[^a-z0-9]+", "-", self.content["scenario"].lower()).strip("-")
        command = shown(self.content.get("command") or "Python")
        lines = [
            f"% slamgauge {self.content.get('version', '')}: {command}",
            r"% needs \usepackage{booktabs}",
            r"\begin{table}",
            r"  \centering",
            rf"  \caption{{{latex_text(self.caption())}}}",
            rf"  \label{{tab:{label}}}",
            rf"  \begin{{tabular}}{{l{'r' * (len(self.keys) + 1)}}}",
            r"    \toprule",
            f"    {head}",
            r"    \midrule",
            *(f"    {row}" for row in body),
            r"    \bottomrule",
            r"  \end{tabular}",
            r"\end{table}",
        ]
        return "\n".join(lines) + "\n"


def read_study_table(
    folder: Path, keys: Sequence[str], estimators: Sequence[str], *, intervals: bool = True
) -> StudyTable:
    """Read the table of the study in a folder; by default its key columns and all estimators.

    Raises:
        UserError: summary.json is not valid, or lacks a column or an estimator.
    """
    path = folder / SUMMARY
    content = read_json(path, "study")
    try:
        entries: Mapping[str, Mapping[str, Any]] = content["estimators"]
        known = [key for key in HELP if _is_column([each.get(key) for each in entries.values()])]
    except (TypeError, KeyError, AttributeError):
        raise UserError(f"{path}: not what `slamgauge study` writes; run it again") from None
    chosen = keys or [key for _, key, _ in columns("study") if key in known][:KEY_COLUMNS]
    _require(chosen, known, "column")
    _require(estimators, entries, "estimator")
    return StudyTable(content, tuple(chosen), tuple(estimators or entries), intervals)


def _is_column(values: Sequence[Any]) -> bool:
    """Whether these values of a key, one for each estimator, are intervals or None."""
    return any(isinstance(each, dict) for each in values) and all("low" in (each or {"low"}) for each in values)


def latex_text(text: str) -> str:
    """Escape a text for LaTeX."""
    return "".join(LATEX.get(sign, sign) for sign in text)


def _title(key: str) -> str:
    return next((title for title, name, _ in columns("study", bounded=True) if name == key), key)


def _require(names: Sequence[str], known: Iterable[str], what: str) -> None:
    for name in names:
        if name not in known:
            raise UserError(f"{name}: no {what} of this study; {did_you_mean(name, known)}")
