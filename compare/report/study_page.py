"""Page of a study: summary of each estimator over many runs, charts, and its worst and median runs."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np

from slamgauge.compare.report.page import TERMS, render
from slamgauge.compare.report.page_elements import Line, Page, Section, looks, origin, pictures, said
from slamgauge.compare.scoring.catalogue import BY_KEY
from slamgauge.compare.scoring.ray_figures import describe
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.scoring.table import ESTIMATOR, Cell, Head, Table, figure
from slamgauge.compare.storage.result_files import REPORT
from slamgauge.compare.studies.paired_comparisons import against_tables
from slamgauge.compare.studies.stored_study import StoredStudy, load_study
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.compare.studies.summary import (
    Request,
    Summary,
    empty_column_lines,
    estimator_table,
    failure_lines,
    optimum_lines,
    too_good_lines,
)

PICTURES = {
    "rmse.png": (
        "RMS position error over runs against time with 95 % intervals, and the bounds",
        "RMS position error over runs, with 95 % intervals.",
    ),
    "nees.png": ("Mean pose NEES over runs against time, with its chi-square band", "Mean pose NEES over runs."),
    "nis.png": ("NIS over its degrees of freedom against time, with its band", "NIS of all runs together."),
    "errors.png": (
        "Errors of single runs within the mean 3-sigma bounds",
        "Errors of single runs, mean 3-sigma bounds.",
    ),
    "ratios.png": ("Box plots of each run's ATE over the optimum's", "ATE of each run over the optimum's in that run."),
}
RUN = Head("run", help="number of the run, from 0")
COMMAND = Head("command", help="repeats the run and writes its page with a replay", words=True)


def study_page(folder: Path) -> dict[str, str]:
    """Return the page of the results of `study` in a folder.

    Raises:
        UserError: If the folder has no study, or its files belong to different studies.
    """
    study = load_study(folder)
    summary = study.summary
    value = request_of(summary).swept
    first, *others = [*pictures(folder, PICTURES), None]
    table, every = estimator_table(summary), run_table(study)
    entries = summary.estimators.items()
    rays = [Line(name, f"a run's {describe(each['rays'])}.") for name, each in entries if each["rays"]]
    notes = [*optimum_lines(summary), *empty_column_lines([summary], "study")]
    page = Page(
        kind="a study",
        title=f"{summary.scenario}{f' at {value}' if value else ''}, {summary.runs} runs",
        lead=[Line(name, f"{each['verdict']}.") for name, each in entries if each["verdict"]],
        notes=said([*notes, *too_good_lines(summary), *failure_lines(summary)]),
        picture=first,
        sections=[
            Section("Metrics of each estimator", "figures", tables=[table, *against_tables(summary.against)]),
            Section("Rays of bearing-only landmarks", lines=rays, level=3),
            Section("Worst and median runs", "look", tables=[worst_table(study)]),
            Section(f"All {len(every.rows)} runs", tables=[every], is_folded=True),
            Section("Consistency and errors", "pictures", pictures=[each for each in others if each is not None]),
        ],
        looks=looks(summary.estimators),
        terms=TERMS["study"],
        origin=origin(study.content, [("Runs", str(summary.runs))]),
    )
    return {REPORT: render(page)}


def request_of(summary: Summary) -> Request:
    """Return what a study requested; a study run from Python has no settings that are known."""
    return summary.request or Request(summary.scenario, (), ",".join(summary.estimators))


def settings_of(request: Request) -> list[str]:
    """Return the settings of a run, with the value of a sweep."""
    return [*request.settings, *filter(None, [request.swept])]


def command_of_run(summary: Summary, seed: int) -> str:
    """Return the `slamgauge run` command of a run; a comment at its end warns of settings that may be missing."""
    request = request_of(summary)
    settings = settings_of(request)
    overrides = ["--set", *settings] if settings else []
    words = ("run", request.scenario, "--seed", str(seed), *overrides, "--estimators", request.estimators)
    known = "" if summary.request else "  # add the --set options of the study, if any"
    return f"{shlex.join(('slamgauge', *words))}{known}"


def worst_table(study: StoredStudy) -> Table:
    """Return the table of the worst and the median run of each estimator, with commands that repeat them."""
    rows: list[list[Cell]] = []
    for name, runs in study.runs.items():
        for which, at in runs_to_look_at(runs).items():
            if at is not None:
                run, ate = int(runs.run[at]), float(runs.figures["ate_m"][at])
                command = command_of_run(study.summary, run_seed(study.summary.seed, run))
                rows.append([Cell(name), Cell(which), Cell(str(run), run), Cell(f"{ate:.3f}", ate), Cell(command)])
    heads = [
        ESTIMATOR,
        Head("which", help="run of the largest or of the median ATE", words=True),
        *(RUN, Head("ATE [m]", help=BY_KEY["ate_m"].help)),
        COMMAND,
    ]
    return Table(heads, rows, "Worst and median runs by ATE", "worst")


def runs_to_look_at(runs: Runs) -> dict[str, int | None]:
    """Return the positions of the worst and the median run by ATE; None without errors."""
    ates = runs.figures["ate_m"] if len(runs.run) else np.zeros(0)
    order = np.argsort(ates)[: np.isfinite(ates).sum()].tolist()
    return {"worst": order[-1] if order else None, "median": order[len(order) // 2] if order else None}


def run_table(study: StoredStudy) -> Table:
    """Return the table of the ATE of every run and estimator, with the seeds of the runs."""
    ates = {
        name: {
            run: ate for run, ate in zip(each.run.tolist(), each.figures["ate_m"].tolist(), strict=True) if ate < np.inf
        }
        for name, each in study.runs.items()
    }
    rows = [
        [Cell(str(run), run), Cell(str(run_seed(study.summary.seed, run)))]
        + [figure(by_run.get(run), "{:.4f}") for by_run in ates.values()]
        + [Cell(command_of_run(study.summary, run_seed(study.summary.seed, run)))]
        for run in range(study.summary.runs)
    ]
    heads = [RUN, Head("seed", help="random seed of the run"), *(Head(name) for name in ates), COMMAND]
    return Table(heads, rows, "ATE [m] of every run", "runs")
