"""Figures of results: drawn from their stored folder."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from slamgauge.compare.estimators.requests import labels_among
from slamgauge.compare.figures.frames import has_rays, save_ray_strip
from slamgauge.compare.figures.result_figures import (
    NO_RESULTS,
    save_bench_figure,
    save_budget_figure,
    save_consistency_figure,
    save_noise_figure,
    save_sweep_figure,
)
from slamgauge.compare.figures.run_figures import save_figure
from slamgauge.compare.figures.study_figures import study_drawings
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.storage.files import load_results, read_json, write_json
from slamgauge.compare.storage.result_files import BENCH, BUDGET, METRICS, NOISE, SUMMARY, SWEEP
from slamgauge.compare.storage.staged_folder import Drawing, decorate, staged_folder
from slamgauge.compare.studies.budget import read_budget
from slamgauge.compare.studies.stored_study import load_study
from slamgauge.compare.studies.summary import Summary
from slamgauge.compare.studies.sweep import Sweep, read_sweep
from slamgauge.errors import UserError

Drawings = dict[str, Drawing]


def write_study(out: str | Path, summary: Summary, runs: dict[str, Runs], step: float) -> bool:
    """Write summary.json, then the figures, into `out`; return whether all figures were written.

    `step` is the time step [s].
    """
    with staged_folder(out, SUMMARY) as stage:
        write_json(stage / SUMMARY, summary.to_json())
    return decorate(Path(out), study_drawings(summary, runs, step), SUMMARY)


def write_sweep(out: Path, sweep: Sweep) -> bool:
    """Write sweep.json, then the figure, into `out`; return whether the figure was written."""
    with staged_folder(out, SWEEP) as stage:
        write_json(stage / SWEEP, sweep.to_json())
    return draw_stored(out, SWEEP)


def draw_stored(out: Path, file: str) -> bool:
    """Draw the figures of the stored results of the main `file` in `out`; return whether all were written."""
    return decorate(out, KINDS[file](out, ()), file)


def drawings_of(folder: Path, names: Sequence[str] = ()) -> Drawings:
    """Return functions that draw the figures of a folder of results, by the name of the figure.

    Args:
        folder: Folder of a run, study, sweep, error budget, noise estimate or bench.
        names: Estimators to draw (default: all); not for budgets and noise.

    Raises:
        UserError: If the folder has no such results or no such estimator.
    """
    file = next((each for each in KINDS if (folder / each).is_file()), None)
    if file is None:
        kinds = "run, study, sweep, budget, noise or bench"
        raise UserError(f"{folder}: contains no {kinds}; give a folder that slamgauge has written")
    if names and file in (BUDGET, NOISE):
        raise UserError(f"estimators: {file} has no estimators to choose; remove this option")
    return KINDS[file](folder, names)


def _of_run(folder: Path, names: Sequence[str]) -> Drawings:
    """Return functions that draw map and errors, the test without ground truth, and rays of the first with any."""
    results = load_results(folder)
    chosen = _chosen(names, results.estimates)
    results = results._replace(estimates={name: results.estimates[name] for name in chosen})
    title, truth, recording, estimates = results
    drawings: Drawings = {"figure": lambda out: save_figure(out, truth, recording, estimates, title)}
    seen = next((name for name in chosen if has_rays(estimates[name])), None)
    if seen is not None:
        drawings["rays"] = lambda out: save_ray_strip(out, results, seen)
    tested = read_json(folder / METRICS).get("without_truth", {})
    entries = {name: tested[name] for name in chosen if name in tested}
    if entries:
        drawings["consistency"] = lambda out: save_consistency_figure(out, entries, title)
    return drawings


def _of_study(folder: Path, names: Sequence[str]) -> Drawings:
    study = load_study(folder)
    runs = {name: study.runs[name] for name in _chosen(names, study.runs)}
    return study_drawings(study.summary, runs, study.step)


def _of_sweep(folder: Path, names: Sequence[str]) -> Drawings:
    sweep = read_sweep(folder)
    sweep = sweep.of(_chosen(names, sweep.summaries[0].estimators))
    return {"sweep": lambda out: save_sweep_figure(out, sweep)}


def _of_budget(folder: Path, _: Sequence[str]) -> Drawings:
    budget = read_budget(folder)
    return {"budget": lambda out: save_budget_figure(out, budget)}


def _chosen(names: Sequence[str], there: Collection[str]) -> list[str]:
    return labels_among(names or [*there], there, NO_RESULTS)


KINDS: dict[str, Callable[[Path, Sequence[str]], Drawings]] = {
    METRICS: _of_run,
    SUMMARY: _of_study,
    SWEEP: _of_sweep,
    BUDGET: _of_budget,
    NOISE: lambda folder, _: {"noise": lambda out: save_noise_figure(out, folder)},
    BENCH: lambda folder, names: {"bench": lambda out: save_bench_figure(out, folder, names)},
}
