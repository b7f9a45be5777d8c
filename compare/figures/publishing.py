"""Results written into folders, their pictures beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from slamgauge.compare.figures.bench_figure import save_bench_figure
from slamgauge.compare.figures.budget_figure import save_budget_figure
from slamgauge.compare.figures.noise_figure import save_noise_figure
from slamgauge.compare.figures.plots import save_figure
from slamgauge.compare.figures.ray_frames import has_rays
from slamgauge.compare.figures.ray_strip import save_ray_strip
from slamgauge.compare.figures.study_figures import save_study_figures
from slamgauge.compare.figures.sweep_figure import save_sweep_figure
from slamgauge.compare.noise.finding import Noise
from slamgauge.compare.noise.noise_json import noise_json
from slamgauge.compare.scoring.comparison import Comparison
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.storage.files import explained, save, write_json, write_tum
from slamgauge.compare.storage.result_files import (
    BENCH,
    BUDGET,
    METRICS,
    NOISE,
    RECORDING,
    STUDY_PICTURES,
    SUMMARY,
    SWEEP,
    SWEEP_FILES,
    TRUTH,
)
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.compare.studies.budget import ErrorBudget
from slamgauge.compare.studies.summary import Summary
from slamgauge.compare.studies.sweep import Sweep


def write_comparison(folder: Path, comparison: Comparison, content: dict[str, Any], title: str) -> None:
    """Write recording, truth, estimates, TUM trajectories, figures and metrics into an existing, empty folder."""
    recording, truth = comparison.recording, comparison.truth
    save(folder / RECORDING, recording)
    if truth is not None:
        save(folder / TRUTH, truth)
    (folder / "estimates").mkdir()
    (folder / "trajectories").mkdir()
    for name, estimate in comparison.estimates.items():
        save(folder / "estimates" / f"{name}.npz", estimate)
        write_tum(folder / "trajectories" / f"{name}.tum", recording.stamps, estimate.poses)
    if truth is not None and truth.poses is not None:
        write_tum(folder / "trajectories" / "truth.tum", recording.stamps, truth.poses)
    save_figure(folder, truth, recording, comparison.estimates, title)
    rays = next((name for name, estimate in comparison.estimates.items() if has_rays(estimate)), None)
    if rays is not None:
        save_ray_strip(folder, truth, recording, rays, comparison.estimates[rays], f"{title}: rays of {rays}")
    write_json(folder / METRICS, content)


def write_study(out: Path, summary: Summary, runs: dict[str, Runs], step: float) -> None:
    """Write summary.json and the figures into `out`; `step` is the time step [s]."""
    with staged_folder(out, (SUMMARY, *STUDY_PICTURES), last=SUMMARY) as stage, explained(out, "written"):
        save_study_figures(stage, summary, runs, step)
        write_json(stage / SUMMARY, summary.to_json())


def write_sweep(out: Path, sweep: Sweep) -> None:
    """Write sweep.json and the figure into `out`."""
    with staged_folder(out, SWEEP_FILES, last=SWEEP) as stage, explained(out, "written"):
        save_sweep_figure(stage, sweep)
        write_json(stage / SWEEP, sweep.to_json())


def write_budget(folder: Path, budget: ErrorBudget) -> None:
    """Write budget.json and the figure into an existing folder."""
    save_budget_figure(folder, budget)
    write_json(folder / BUDGET, budget.to_json())


def write_noise(folder: Path, noise: Noise) -> None:
    """Write noise.json and the figure into an existing folder."""
    save_noise_figure(folder, noise)
    write_json(folder / NOISE, noise_json(noise))


def write_bench(folder: Path, result: dict[str, Any]) -> None:
    """Write bench.json and the figure into an existing folder."""
    save_bench_figure(folder / "bench.png", result)
    write_json(folder / BENCH, result)
