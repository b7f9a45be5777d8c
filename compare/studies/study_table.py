"""The table of a study for other programs and for papers: CSV, LaTeX with booktabs, Markdown."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any, Literal

from slamgauge.compare.scoring.catalogue import CATALOGUE, columns
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.text_table import cell, interval_cell
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import SUMMARY
from slamgauge.compare.storage.safe_names import shown
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

Form = Literal["csv", "latex", "markdown"]
KEY_COLUMNS = 4  # the first ones of the printed table are what is written unless columns are chosen
HELP = {each.key: each.help for each in CATALOGUE}
LATEX = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"} | {
    sign: f"\\{sign}" for sign in "&%$#_{}"
}


@dataclass(frozen=True)
class StudyTable:
    """Means over runs with 95 % intervals, read from summary.json.

    Attributes:
        content: of summary.json.
        keys: of its columns, figures of the catalogue.
        estimators: the rows.
        intervals: whether intervals are written beside means.
    """

    content: Mapping[str, Any]
    keys: tuple[str, ...]
    estimators: tuple[str, ...]
    intervals: bool = True

    def text(self, form: Form) -> str:
        """The table in one of the forms."""
        return {"csv": self._csv, "latex": self._latex, "markdown": self._markdown}[form]()

    def caption(self) -> str:
        """What the table shows, in a sentence or two."""
        seed, runs = self.content["seed"], self.content["runs"]
        what = "means with 95 % intervals" if self.intervals else "means"
        told = "; ".join(f"{_title(key)}: {HELP[key]}" for key in self.keys)
        return f"{self.content['scenario']}, {runs} runs (seed {seed}), {what}. {told}."

    def _interval(self, estimator: str, key: str) -> Interval | None:
        found = self.content["estimators"][estimator].get(key)
        return Interval(**found) if found is not None else None

    def _cells(self, estimator: str) -> list[str]:
        forms = {key: form for _, key, form in columns("study", bounded=True)}
        found = [(self._interval(estimator, key), forms.get(key, "{:.4g}")) for key in self.keys]
        if self.intervals:
            return [interval_cell(each, form) for each, form in found]
        return [cell(None if each is None else each.mean, form) for each, form in found]

    def _csv(self) -> str:
        """Full precision; each column of its own, `KEY_low` and `KEY_high` for the ends of the interval."""
        ends = ("mean", "low", "high") if self.intervals else ("mean",)
        out = StringIO()
        writer = csv.writer(out, lineterminator="\n")
        names = [key if end == "mean" else f"{key}_{end}" for key in self.keys for end in ends]
        writer.writerow(["estimator", "runs", *names])
        for name in self.estimators:
            found = [self._interval(name, key) for key in self.keys]
            figures = [getattr(each, end, None) for each in found for end in ends]
            writer.writerow([shown(name), self.content["estimators"][name]["runs"], *figures])
        return out.getvalue()

    def _rows(self) -> list[list[str]]:
        head = ["estimator", "runs", *map(_title, self.keys)]
        runs = {name: str(self.content["estimators"][name]["runs"]) for name in self.estimators}
        return [head, *([shown(name), runs[name], *self._cells(name)] for name in self.estimators)]

    def _markdown(self) -> str:
        head, *body = [[text.replace("|", r"\|") for text in row] for row in self._rows()]
        rule = ["---", *("---:" for _ in head[1:])]
        return "\n".join(f"| {' | '.join(row)} |" for row in (head, rule, *body)) + "\n"

    def _latex(self) -> str:
        head, *body = [[latex_text(text).replace("±", r"$\pm$") for text in row] for row in self._rows()]
        label = re.sub(r"[^a-z0-9]+", "-", self.content["scenario"].lower()).strip("-")
        command = shown(self.content.get("command") or "Python")
        lines = [
            f"% slamgauge {self.content.get('version', '')}: {command}",
            r"% needs \usepackage{booktabs}",
            r"\begin{table}",
            r"  \centering",
            rf"  \caption{{{latex_text(self.caption())}}}",
            rf"  \label{{tab:{label}}}",
            rf"  \begin{{tabular}}{{l{'r' * (len(head) - 1)}}}",
            r"    \toprule",
            rf"    {' & '.join(head)} \\",
            r"    \midrule",
            *(rf"    {' & '.join(row)} \\" for row in body),
            r"    \bottomrule",
            r"  \end{tabular}",
            r"\end{table}",
        ]
        return "\n".join(lines) + "\n"


def read_study_table(
    folder: Path, keys: Sequence[str], estimators: Sequence[str], *, intervals: bool = True
) -> StudyTable:
    """The table of the study in a folder; without keys its key columns, without estimators all of them.

    Raises:
        UserError: summary.json is not one, or there is no such column or estimator.
    """
    path = folder / SUMMARY
    content = read_json(path, "study")
    try:
        there = {name: {*entry} for name, entry in content["estimators"].items()}
        known = [key for key in HELP if any(isinstance(each.get(key), dict) for each in content["estimators"].values())]
        known = [key for key in known if all("low" in (e.get(key) or {"low"}) for e in content["estimators"].values())]
    except (TypeError, KeyError, AttributeError):
        raise UserError(f"{path}: not what `slamgauge study` writes; run it again") from None
    chosen = keys or [key for _, key, _ in columns("study") if key in known][:KEY_COLUMNS]
    _require(chosen, known, "column")
    _require(estimators, there, "estimator")
    return StudyTable(content, tuple(chosen), tuple(estimators or there), intervals)


def latex_text(text: str) -> str:
    """A text as LaTeX sets it letter by letter."""
    return "".join(LATEX.get(sign, sign) for sign in text)


def _title(key: str) -> str:
    return next((title for title, name, _ in columns("study", bounded=True) if name == key), key)


def _require(names: Sequence[str], known: Sequence[str] | Mapping[str, object], what: str) -> None:
    for name in names:
        if name not in known:
            raise UserError(f"{name}: no {what} of this study; {did_you_mean(name, known)}")
