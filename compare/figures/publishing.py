"""Figures of results: drawn next to new results, or again from a stored folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from slamgauge.compare.estimators.requests import labels_among
from slamgauge.compare.figures.budget_figure import save_budget_figure
from slamgauge.compare.figures.consistency_figure import save_consistency_figure
from slamgauge.compare.figures.ray_frames import has_rays
from slamgauge.compare.figures.ray_strip import save_ray_strip
from slamgauge.compare.figures.run_figures import save_drift_figure, save_figure
from slamgauge.compare.figures.study_figures import study_drawings
from slamgauge.compare.figures.sweep_figure import save_sweep_figure
from slamgauge.compare.scoring.comparison import Comparison, without_truth_entries
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.storage.best_effort import Drawing, decorate
from slamgauge.compare.storage.files import of_this_version, read_json, write_json
from slamgauge.compare.storage.result_files import (
    BENCH,
    BUDGET,
    METRICS,
    NOISE,
    REPORT,
    RUN_PICTURES,
    STUDY_PICTURES,
    SUMMARY,
    SWEEP,
    SWEEP_FILES,
    SWEEP_PICTURES,
    pictures,
)
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.compare.storage.stored_results import load_results
from slamgauge.compare.studies.budget import read_budget
from slamgauge.compare.studies.stored_study import load_study
from slamgauge.compare.studies.summary import Summary
from slamgauge.compare.studies.sweep import Sweep, read_sweep
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

Drawings = dict[str, Drawing]
NO_RESULTS = "has no results in the folder"


def draw_comparison(out: Path, comparison: Comparison, title: str) -> bool:
    """Draw the figures of the run in `out`; return whether all were written."""
    truth, recording, estimates = comparison.truth, comparison.recording, comparison.estimates
    drawings = _drawings_of_run(truth, recording, estimates, title)
    drawings |= _without_truth(without_truth_entries(comparison), title)
    return decorate(out, drawings, RUN_PICTURES)


def _without_truth(entries: Mapping[str, Any], title: str) -> Drawings:
    """Return the function that draws the test without ground truth, if any filter was tested."""
    return {"consistency": lambda out: save_consistency_figure(out, entries, title)} if entries else {}


def write_study(out: str | Path, summary: Summary, runs: dict[str, Runs], step: float) -> bool:
    """Write summary.json, then the figures, into `out`; return whether all figures were written.

    `step` is the time step [s].
    """
    with staged_folder(out, (SUMMARY, *STUDY_PICTURES, REPORT), last=SUMMARY) as stage:
        write_json(stage / SUMMARY, summary.to_json())
    return decorate(Path(out), study_drawings(summary, runs, step), STUDY_PICTURES)


def write_sweep(out: Path, sweep: Sweep) -> bool:
    """Write sweep.json, then the figure, into `out`; return whether the figure was written."""
    with staged_folder(out, SWEEP_FILES, last=SWEEP) as stage:
        write_json(stage / SWEEP, sweep.to_json())
    return decorate(out, {"sweep": lambda stage: save_sweep_figure(stage, sweep)}, SWEEP_PICTURES)


def draw_stored(out: Path, file: str) -> bool:
    """Draw the figure of the stored budget, noise or bench `file` in `out`; return whether it was written."""
    drawings = KINDS[file](out, (), None)
    return decorate(out, drawings, pictures(*drawings))


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
    title, truth, recording, estimates = load_results(folder)
    chosen = labels_among(names or [*estimates], estimates, NO_RESULTS)
    if band is not None:
        labels_among([band], chosen, "is not among the drawn estimators")
    estimates = {name: estimates[name] for name in chosen}
    content = read_json(folder / METRICS, "run")
    entries = {name: content["estimators"][name] for name in chosen}
    drawings = _drawings_of_run(truth, recording, estimates, title, band, drift=not names)
    if any(each.get("rpe_by_distance") for each in entries.values()):
        drawings["drift"] = lambda out: save_drift_figure(out, entries, title)
    tested = content.get("without_truth", {})
    return drawings | _without_truth({name: tested[name] for name in chosen if name in tested}, title)


def _drawings_of_run(
    truth: Truth | None,
    recording: Recording,
    estimates: Mapping[str, Estimate],
    title: str,
    band: str | None = None,
    *,
    drift: bool = True,
) -> Drawings:
    """Return functions that draw the map with the errors, and the rays of the first estimate that has any."""
    drawings: Drawings = {"figure": lambda out: save_figure(out, truth, recording, estimates, title, band, drift=drift)}
    name = next((name for name, estimate in estimates.items() if has_rays(estimate)), None)
    if name is not None:
        rays = f"{title}: rays of {name}"
        drawings["rays"] = lambda out: save_ray_strip(out, truth, recording, name, estimates[name], rays)
    return drawings


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
    from slamgauge.compare.figures.noise_figure import save_noise_figure  # here: its libraries are slow to start

    content = read_json(folder / NOISE, "noise")

    def draw(out: Path) -> None:
        with of_this_version(folder / NOISE):
            save_noise_figure(out, content)

    return {"noise": draw}


def _of_bench(folder: Path, names: Sequence[str], _: str | None) -> Drawings:
    from slamgauge.compare.figures.bench_figure import save_bench_figure  # here: its libraries are slow to start

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
