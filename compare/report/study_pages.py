"""Pages of a study, with the commands of its runs, of a sweep, and of an error budget."""

from __future__ import annotations

import shlex
from pathlib import Path
from urllib.parse import quote

import numpy as np

from slamgauge.compare.report.page import Line, Page, Section, looks, origin, pictures, said
from slamgauge.compare.scoring.intervals import number
from slamgauge.compare.scoring.runs import rays_text
from slamgauge.compare.scoring.table import Cell, Head, Table, figure
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import BUDGET, REPORT, SWEEP
from slamgauge.compare.studies.budget import notes, read_budget, rung_table, verdict
from slamgauge.compare.studies.paired_comparisons import against_tables
from slamgauge.compare.studies.stored_study import StoredStudy, load_study
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.compare.studies.summary import (
    Request,
    Summary,
    estimator_table,
    failure_lines,
    optimum_lines,
    too_good_lines,
)
from slamgauge.compare.studies.sweep import faults, read_sweep, value_table
from slamgauge.compare.studies.sweep import notes as sweep_notes

PICTURES = {
    "rmse.png": "RMS position error over runs against time, with 95 % intervals, and the bounds.",
    "nees.png": "Mean pose NEES over runs against time, with its chi-square band.",
    "nis.png": "NIS of all runs together over its degrees of freedom, with its band.",
    "errors.png": "Errors of single runs within the mean 3-sigma bounds.",
    "sweep.png": "Error, consistency, reported sigma and size of the map against the value; bars are 95 % intervals.",
    "budget.png": "Each bar starts at the end of the previous one; its line is the 95 % interval.",
    "ratios.png": "ATE of each run over the optimum's in that run, as box plots.",
}
TERMS = (
    ("\u00b1", "half the width of the 95 % interval of the mean over runs"),
    ("band", "interval of the mean for consistent estimates, at the stated level"),
)
RUN = Head("run", help="number of the run, from 0")
COMMAND = Head("command", help="repeats the run and writes its page with a replay", words=True)


def study_page(folder: Path) -> Page:
    """Return the page of the results of `study` in a folder."""
    study = load_study(folder)
    summary = study.summary
    value = f" at {summary.request.swept}" if summary.request and summary.request.swept else ""
    first, *others = [*pictures(folder, PICTURES), None]
    entries = summary.estimators.items()
    rays = [Line(name, f"a run's {rays_text(each['rays'])}.") for name, each in entries if each["rays"]]
    tables = [estimator_table(summary), *against_tables(summary.against)]
    return Page(
        kind="a study",
        title=f"{summary.scenario}{value}, {summary.runs} runs",
        lead=[Line(name, f"{each['verdict']}.") for name, each in entries if each["verdict"]],
        notes=said([*optimum_lines(summary), *too_good_lines(summary), *failure_lines(summary)]),
        picture=first,
        sections=[
            Section("Metrics of each estimator", "figures", tables=tables),
            Section("Rays of bearing-only landmarks", lines=rays, level=3),
            Section(f"All {summary.runs} runs, the worst first", "runs", tables=[run_table(study)], is_folded=True),
            Section("Consistency and errors", "pictures", pictures=[each for each in others if each is not None]),
        ],
        looks=looks(summary.estimators),
        terms=TERMS,
        origin=origin(study.content, [("Runs", str(summary.runs))]),
    )


def sweep_page(folder: Path) -> Page:
    """Return the page of the results of `study --sweep` in a folder."""
    sweep, content = read_sweep(folder), read_json(folder / SWEEP)
    digests = [(f"Digest at {value}", each.digest) for value, each in zip(sweep.values, sweep.summaries, strict=True)]
    links = {value: f"{quote(f'{sweep.key}={value}')}/{REPORT}" for value in sweep.values}
    return Page(
        kind="a sweep",
        title=f"{sweep.scenario} over {sweep.key}, {sweep.runs} runs at each value",
        lead=[Line(*each) for each in faults(sweep).items()],
        notes=said(["each value in the table links to the page of its study, with all runs", *sweep_notes(sweep)]),
        sections=[
            Section("Values", "values", tables=[value_table(sweep, links)]),
            Section("Figure", "pictures", pictures=pictures(folder, PICTURES)),
        ],
        origin=origin(content, [("Runs at each value", str(sweep.runs)), *digests]),
    )


def budget_page(folder: Path) -> Page:
    """Return the page of the results of `budget` in a folder."""
    budget, content = read_budget(folder), read_json(folder / BUDGET)
    return Page(
        kind="an error budget",
        title=f"Where the error of {budget.filter} comes from: {budget.scenario}",
        lead=said([verdict(budget)]),
        notes=said(notes(budget)),
        sections=[
            Section("Parts of the error", "parts", tables=[rung_table(budget)]),
            Section("Figure", "pictures", pictures=pictures(folder, PICTURES)),
        ],
        origin=origin(content, [("Filter", budget.filter), ("Runs", str(budget.runs))]),
    )


def command_of_run(summary: Summary, seed: int) -> str:
    """Return the `slamgauge run` command of a run; a comment at its end warns of settings that may be missing."""
    request = summary.request or Request(summary.scenario, (), ",".join(summary.estimators))
    settings = [*request.settings, *filter(None, [request.swept])]
    overrides = ["--set", *settings] if settings else []
    words = ("run", request.scenario, "--seed", str(seed), *overrides, "--estimators", request.estimators)
    known = "" if summary.request else "  # add the --set options of the study, if any"
    return f"{shlex.join(('slamgauge', *words))}{known}"


def run_table(study: StoredStudy) -> Table:
    """Return the table of the ATE of every run and estimator, with the commands that repeat the runs."""
    ates = np.full((study.summary.runs, len(study.runs)), np.nan)
    for column, each in zip(ates.T, study.runs.values(), strict=True):
        column[each.run] = each.figures["ate_m"]
    rows: list[list[Cell]] = []
    for run in np.argsort(-ates[:, 0], kind="stable").tolist():  # NaN is last
        seed = run_seed(study.summary.seed, run)
        command = command_of_run(study.summary, seed)
        cells = [figure(number(ate), "{:.4f}") for ate in ates[run].tolist()]
        rows.append([figure(run, "{}"), Cell(str(seed)), *cells, Cell(command)])
    heads = [RUN, Head("seed", help="random seed of the run"), *(Head(name) for name in study.runs), COMMAND]
    caption = "ATE [m] of every run, first the largest of the first estimator; click a column title to sort"
    return Table(heads, rows, caption, "runs")
