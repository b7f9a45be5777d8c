"""Write results into folders, then their figures next to them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slamgauge.compare.figures.bench_figure import save_bench_figure
from slamgauge.compare.figures.budget_figure import save_budget_figure
from slamgauge.compare.figures.noise_figure import save_noise_figure
from slamgauge.compare.figures.ray_frames import has_rays
from slamgauge.compare.figures.ray_strip import save_ray_strip
from slamgauge.compare.figures.run_figures import save_figure
from slamgauge.compare.figures.study_figures import study_drawings
from slamgauge.compare.figures.sweep_figure import save_sweep_figure
from slamgauge.compare.scoring.comparison import Comparison
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.storage.best_effort import Drawing, decorate
from slamgauge.compare.storage.files import write_json
from slamgauge.compare.storage.result_files import (
    BENCH,
    BENCH_PICTURES,
    BUDGET,
    BUDGET_PICTURES,
    METRICS,
    NOISE,
    NOISE_PICTURES,
    REPORT,
    RUN_PICTURES,
    STUDY_PICTURES,
    SUMMARY,
    SWEEP,
    SWEEP_FILES,
    SWEEP_PICTURES,
)
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.compare.studies.budget import ErrorBudget
from slamgauge.compare.studies.summary import Summary
from slamgauge.compare.studies.sweep import Sweep
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth


def draw_comparison(out: Path, comparison: Comparison, title: str) -> bool:
    """Draw the figures of the run in `out`; return whether all were written."""
    truth, recording, estimates = comparison.truth, comparison.recording, comparison.estimates
    drawings: dict[str, Drawing] = {"figure": lambda stage: save_figure(stage, truth, recording, estimates, title)}
    return decorate(out, METRICS, drawings | ray_drawing(truth, recording, estimates, title), RUN_PICTURES)


def ray_drawing(
    truth: Truth | None, recording: Recording, estimates: Mapping[str, Estimate], title: str
) -> dict[str, Drawing]:
    """Return a function that draws the rays of the first estimate that has any, by the name of the figure."""
    name = next((name for name, estimate in estimates.items() if has_rays(estimate)), None)
    if name is None:
        return {}
    title = f"{title}: rays of {name}"
    return {"rays": lambda stage: save_ray_strip(stage, truth, recording, name, estimates[name], title)}


def write_study(out: str | Path, summary: Summary, runs: dict[str, Runs], step: float) -> bool:
    """Write summary.json, then the figures, into `out`; return whether all figures were written.

    `step` is the time step [s].
    """
    with staged_folder(out, (SUMMARY, *STUDY_PICTURES, REPORT), last=SUMMARY) as stage:
        write_json(stage / SUMMARY, summary.to_json())
    return decorate(Path(out), SUMMARY, study_drawings(summary, runs, step), STUDY_PICTURES)


def write_sweep(out: Path, sweep: Sweep) -> bool:
    """Write sweep.json, then the figure, into `out`; return whether the figure was written."""
    with staged_folder(out, SWEEP_FILES, last=SWEEP) as stage:
        write_json(stage / SWEEP, sweep.to_json())
    return decorate(out, SWEEP, {"sweep": lambda stage: save_sweep_figure(stage, sweep)}, SWEEP_PICTURES)


def draw_budget(out: Path, budget: ErrorBudget) -> bool:
    """Draw the figure of the budget in `out`; return whether it was written."""
    return decorate(out, BUDGET, {"budget": lambda stage: save_budget_figure(stage, budget)}, BUDGET_PICTURES)


def draw_noise(out: Path, content: dict[str, Any]) -> bool:
    """Draw the figure of the noise in `out`; return whether it was written."""
    return decorate(out, NOISE, {"noise": lambda stage: save_noise_figure(stage, content)}, NOISE_PICTURES)


def draw_bench(out: Path, result: dict[str, Any]) -> bool:
    """Draw the figure of the step times in `out`; return whether it was written."""
    return decorate(out, BENCH, {"bench": lambda stage: save_bench_figure(stage, result)}, BENCH_PICTURES)
