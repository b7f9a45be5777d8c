"""Draw the figures of stored results again, with another width or a choice of estimators."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from slamgauge.compare.estimators.requests import labels_among
from slamgauge.compare.figures.bench_figure import save_bench_figure
from slamgauge.compare.figures.budget_figure import save_budget_figure
from slamgauge.compare.figures.drift_figure import save_drift_figure
from slamgauge.compare.figures.noise_figure import save_noise_figure
from slamgauge.compare.figures.publishing import ray_drawing
from slamgauge.compare.figures.run_figures import save_figure
from slamgauge.compare.figures.study_figures import study_drawings
from slamgauge.compare.figures.sweep_figure import save_sweep_figure
from slamgauge.compare.storage.best_effort import Drawing
from slamgauge.compare.storage.files import of_this_version, read_json
from slamgauge.compare.storage.result_files import BENCH, BUDGET, METRICS, NOISE, SUMMARY, SWEEP
from slamgauge.compare.storage.results_folder import load_results
from slamgauge.compare.studies.budget import read_budget
from slamgauge.compare.studies.stored_study import load_study
from slamgauge.compare.studies.sweep import read_sweep
from slamgauge.errors import UserError

Drawings = dict[str, Drawing]
NO_RESULTS = "has no results in the folder"


def drawings_of(folder: Path, names: Sequence[str] = (), band: str | None = None) -> Drawings:
    """Return functions that draw the figures of a folder of results, by the name of the figure.

    Args:
        folder: Folder of a run, study, sweep, error budget, noise estimate or bench.
        names: Estimators to draw (default: all); not for budgets and noise.
        band: Estimator whose 3-sigma bounds are filled; only for runs.

    Raises:
        UserError: If the folder has no such results or no such estimator.
    """
    for file, drawings in KINDS.items():
        if (folder / file).is_file():
            if band is not None and file != METRICS:
                raise UserError(f"band {band}: only figures of a run have a band; remove this option")
            return drawings(folder, names, band)
    raise UserError(
        f"{folder}: contains no run, study, sweep, budget, noise or bench; give a folder that slamgauge has written"
    )


def _of_run(folder: Path, names: Sequence[str], band: str | None) -> Drawings:
    found = load_results(folder)
    chosen = labels_among(names or [*found.estimates], found.estimates, NO_RESULTS)
    if band is not None:
        labels_among([band], chosen, "is not among the drawn estimators")
    estimates = {name: found.estimates[name] for name in chosen}
    metrics = read_json(folder / METRICS, "run")["estimators"]
    entries = {name: metrics[name] for name in chosen}
    drawings: Drawings = {
        "figure": lambda out: save_figure(
            out, found.truth, found.recording, estimates, found.title, band, drift=not names
        )
    }
    if any(each.get("rpe_by_distance") for each in entries.values()):
        drawings["drift"] = lambda out: save_drift_figure(out, entries, found.title)
    return drawings | ray_drawing(found.truth, found.recording, estimates, found.title)


def _of_study(folder: Path, names: Sequence[str], _: str | None) -> Drawings:
    study = load_study(folder)
    chosen = labels_among(names or [*study.runs], study.runs, NO_RESULTS)
    return study_drawings(study.summary, {name: study.runs[name] for name in chosen}, study.step)


def _of_sweep(folder: Path, names: Sequence[str], _: str | None) -> Drawings:
    sweep = read_sweep(folder)
    there = sweep.summaries[0].estimators
    sweep = sweep.of(labels_among(names or [*there], there, NO_RESULTS))
    return {"sweep": lambda out: save_sweep_figure(out, sweep)}


def _of_budget(folder: Path, names: Sequence[str], _: str | None) -> Drawings:
    if names:
        raise UserError("estimators: a budget has one filter; remove this option")
    budget = read_budget(folder)
    return {"budget": lambda out: save_budget_figure(out, budget)}


def _of_noise(folder: Path, names: Sequence[str], _: str | None) -> Drawings:
    if names:
        raise UserError("estimators: the noise of a recording has no estimators; remove this option")
    content = read_json(folder / NOISE, "noise")

    def draw(out: Path) -> None:
        with of_this_version(folder / NOISE):
            save_noise_figure(out, content)

    return {"noise": draw}


def _of_bench(folder: Path, names: Sequence[str], _: str | None) -> Drawings:
    content = read_json(folder / BENCH, "bench")

    def draw(out: Path) -> None:
        with of_this_version(folder / BENCH):
            measured = content["estimators"]
            chosen = labels_among(names or [*measured], measured, NO_RESULTS)
            save_bench_figure(out, {**content, "estimators": {name: measured[name] for name in chosen}})

    return {"bench": draw}


KINDS: dict[str, Callable[[Path, Sequence[str], str | None], Drawings]] = {
    METRICS: _of_run,
    SUMMARY: _of_study,
    SWEEP: _of_sweep,
    BUDGET: _of_budget,
    NOISE: _of_noise,
    BENCH: _of_bench,
}
