"""A study read from its folder, without running anything, and its table for papers and other programs."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

from pydantic import TypeAdapter

from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.simulation import informed
from slamgauge.compare.scoring.catalogue import BY_KEY, heads
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.runs import Runs
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
from slamgauge.compare.storage.result_files import OPTIMA, STORE, SUMMARY, shown
from slamgauge.compare.studies.store import digest, read_store
from slamgauge.compare.studies.summary import EstimatorSummary, Summary, summarise
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

KEY_COLUMNS = 4  # default number of columns of tables for papers: the first ones of the printed table


class StoredStudy(NamedTuple):
    """A study read from its folder: content of summary.json, summary of its stored runs, these by label, time step."""

    content: dict[str, Any]
    summary: Summary
    runs: dict[str, Runs]
    step: float  # s


def read_summary(path: Path) -> tuple[dict[str, Any], Summary]:
    """Return the content of a summary.json, and the summary of its figures."""
    content = read_json(path)
    with of_this_version(path):
        entries = {
            name: EstimatorSummary({key: _figure(each) for key, each in entry.items()})
            for name, entry in content["estimators"].items()
        }
        known = {**content, "estimators": entries, "per_run": content["per_run"]}
        return content, TypeAdapter(Summary).validate_python(known)


def _figure(value: Any) -> Any:
    return Interval(**value) if isinstance(value, dict) and {*value} == {"mean", "low", "high"} else value


def load_study(folder: Path) -> StoredStudy:
    """Read the study in a folder; in a sweep, the runs of the optima are in the folder `optimum` next to it.

    Raises:
        UserError: the folder has no study, or files of different studies.
    """
    content, summary = read_summary(folder / SUMMARY)
    labels = [*summary.estimators]
    stored, runs = read_store(folder / STORE, summary.digest, labels, summary.runs)
    missing = [label for label in labels if label not in runs]
    exact = informed(stored)
    optima = optima_beside(folder.parent / OPTIMA, exact, summary.seed) / STORE
    if missing and optima.is_file():
        runs |= read_store(optima, digest(exact, summary.seed), missing, summary.runs)[1]
    for label in labels:
        if label not in runs:
            raise UserError(f"{folder / STORE}: has no run of {label}; give the command of the study again")
    runs = {label: runs[label] for label in labels}
    summary = replace(summary, estimators=summarise(runs), loaded=runs)
    return StoredStudy(content, summary, runs, stored.trajectory.step)


def optima_beside(parent: Path, exact: Scenario, seed: int, prefix: str = "") -> Path:
    """Return the folder in `parent` of the optima of an `informed` scenario, which all of its measurements share."""
    return parent / f"{prefix}{digest(exact, seed)[:12]}"


def study_table(
    folder: Path,
    form: Literal["csv", "latex", "markdown"],
    keys: Sequence[str],
    estimators: Sequence[str],
    *,
    intervals: bool = True,
) -> str:
    """Return the table of the study in a folder; by default its key columns and all estimators.

    Raises:
        UserError: summary.json is not valid, or lacks a column or an estimator.
    """
    content, summary = read_summary(folder / SUMMARY)
    entries = summary.estimators
    averaged = {key for entry in entries.values() for key, value in entry.items() if isinstance(value, Interval)}
    known = [key for key in BY_KEY if key in averaged]
    chosen = keys or [head.key for head in heads("study") if head.key in known][:KEY_COLUMNS]
    _require(chosen, known, "column")
    _require(estimators, entries, "estimator")
    titles = {head.key: head for head in heads("study", bounded=True)}
    others = {key: Head(key, help=BY_KEY[key].help, key=key, form="{:.4g}") for key in chosen}
    found = [titles.get(key, others[key]) for key in chosen]
    rows: list[list[Cell]] = []
    for name in estimators or entries:
        row, runs = [Cell(shown(name))], entries[name]["runs"]
        row.append(Cell(str(runs), runs))
        for head in found:
            value = entries[name].get(head.key)
            row.append(Cell(figure(value if intervals or value is None else value.mean, head.form).text, value))
        rows.append(row)
    what = "means with 95 % intervals" if intervals else "means"
    meanings = "; ".join(f"{head.title}: {head.help}" for head in found)
    caption = f"{summary.scenario}, {summary.runs} runs (seed {summary.seed}), {what}. {meanings}."
    table = Table([ESTIMATOR, RUNS, *found], rows, caption)
    if form == "csv":
        return csv_text(table, intervals=intervals)
    if form == "markdown":
        return markdown_text(table)
    label = re.sub(r"[^a-z0-9]+", "-", summary.scenario.lower()).strip("-")
    command = shown(content.get("command") or "Python")
    return latex_text(table, label, f"slamgauge {content.get('version', '')}: {command}")


def _require(names: Sequence[str], known: Iterable[str], what: str) -> None:
    for name in names:
        if name not in known:
            raise UserError(f"{name}: no {what} of this study; {did_you_mean(name, known)}")
