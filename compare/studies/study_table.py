"""The table of a stored study for papers and other programs: means over runs with 95 % intervals."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from slamgauge.compare.scoring.catalogue import BY_KEY, heads
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.table import (
    ESTIMATOR,
    RUNS,
    Cell,
    Head,
    Table,
    csv_text,
    figure,
    latex_text,
    markdown_text,
)
from slamgauge.compare.storage.files import of_this_version, read_json
from slamgauge.compare.storage.result_files import SUMMARY
from slamgauge.compare.storage.safe_names import shown
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

Form = Literal["csv", "latex", "markdown"]
KEY_COLUMNS = 4  # default: the first columns of the printed table


def study_table(
    folder: Path, form: Form, keys: Sequence[str], estimators: Sequence[str], *, intervals: bool = True
) -> str:
    """Return the table of the study in a folder; by default its key columns and all estimators.

    Raises:
        UserError: summary.json is not valid, or lacks a column or an estimator.
    """
    path = folder / SUMMARY
    content = read_json(path, "study")
    with of_this_version(path):
        entries: Mapping[str, Mapping[str, Any]] = content["estimators"]
        known = [key for key in BY_KEY if any(_is_interval(each.get(key)) for each in entries.values())]
        chosen = keys or [head.key for head in heads("study") if head.key in known][:KEY_COLUMNS]
        _require(chosen, known, "column")
        _require(estimators, entries, "estimator")
        titles = {head.key: head for head in heads("study", bounded=True)}
        found = [titles.get(key, Head(key, help=BY_KEY[key].help, key=key, form="{:.4g}")) for key in chosen]
        rows = [_row(name, entries[name], found, intervals=intervals) for name in estimators or entries]
        what = "means with 95 % intervals" if intervals else "means"
        meanings = "; ".join(f"{head.title}: {head.help}" for head in found)
        caption = f"{content['scenario']}, {content['runs']} runs (seed {content['seed']}), {what}. {meanings}."
        table = Table([ESTIMATOR, RUNS, *found], rows, caption)
        if form == "csv":
            return csv_text(table, intervals=intervals)
        if form == "markdown":
            return markdown_text(table)
        label = re.sub(r"[^a-z0-9]+", "-", content["scenario"].lower()).strip("-")
        command = shown(content.get("command") or "Python")
        return latex_text(table, label, f"slamgauge {content.get('version', '')}: {command}")


def _row(name: str, entry: Mapping[str, Any], found: Sequence[Head], *, intervals: bool) -> list[Cell]:
    cells = [Cell(shown(name)), Cell(str(entry["runs"]), entry["runs"])]
    for head in found:
        value = None if entry.get(head.key) is None else Interval(**entry[head.key])
        text = figure(value if intervals or value is None else value.mean, head.form).text
        cells.append(Cell(text, value))
    return cells


def _is_interval(value: object) -> bool:
    return isinstance(value, dict) and "low" in value


def _require(names: Sequence[str], known: Iterable[str], what: str) -> None:
    for name in names:
        if name not in known:
            raise UserError(f"{name}: no {what} of this study; {did_you_mean(name, known)}")
