"""Step time against map size.

The workload is two rounds of a circle at 1 m/s with a 10 m sensor; medians are over the second round, when the map is
complete.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.estimators.registry import CAUSAL
from slamgauge.compare.estimators.requests import Chosen
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scoring.table import ESTIMATOR, Head, Table, cell
from slamgauge.compare.scoring.text_page import Page
from slamgauge.compare.storage.progress import counted
from slamgauge.compare.storage.result_files import origin
from slamgauge.estimate import Estimate
from slamgauge.memory import require_memory
from slamgauge.recording import Recording

WORKLOAD = (
    "circle, 1 m/s, two rounds, 0.1 s steps, range 10 m, the exercise's noise, known association; "
    "up to 300 landmarks: radius 10 m, landmarks uniform in a 30 x 30 m box; "
    "above: radius 20 m, landmarks uniform within 9.8 m of the circle; none nearer to it than 0.5 m"
)
COPIES = 3.0  # memory for a filter, in copies of its covariance


def workload(landmarks: int, seed: int = 0) -> Scenario:
    """Return the scenario of the bench with that many landmarks."""
    radius = 10.0 if landmarks <= 300 else 20.0
    return Scenario.model_validate(
        {
            "name": f"bench-{landmarks}",
            "description": WORKLOAD,
            "trajectory": {"step": 0.1, "speed": 1.0, "yaw_rate": 1.0 / radius, "duration": 4.0 * np.pi * radius},
            "motion": {"sigma_speed": 0.3, "sigma_yaw_rate_deg": 3.0},
            "sensor": {"kind": "range-bearing", "max_range": 10.0, "sigma_range": 0.1, "sigma_bearing_deg": 5.0},
            "landmarks": {"positions": _positions(landmarks, radius, np.random.default_rng(seed)).tolist()},
        }
    )


def _positions(landmarks: int, radius: float, rng: np.random.Generator) -> Float:
    reach, furthest = (15.0, np.inf) if landmarks <= 300 else (radius + 9.8, 9.8)
    drawn = rng.uniform(-reach, reach, (10 * landmarks, 2))
    distance = np.abs(np.hypot(*drawn.T) - radius)
    return np.array([0.0, radius]) + drawn[(distance >= 0.5) & (distance <= furthest)][:landmarks]


def run_bench(sizes: Sequence[int], chosen: Chosen, seed: int = 0) -> dict[str, Any]:
    """Measure every estimator on every map size; see `slamgauge bench --json` for the keys.

    Raises:
        UserError: an unknown estimator, or a map whose covariance does not fit into memory.
    """
    for size in sizes:
        what = f"landmarks: the covariance of {size}"
        require_memory(COPIES * 8.0 * (3.0 + 2.0 * size) ** 2, what, "give a smaller map")
    contestants = load_estimators(chosen)
    results: dict[str, dict[str, dict[str, float]]] = {name: {} for name in contestants}
    with counted(len(sizes) * len(contestants), "run") as progress:
        for size in sizes:
            _, recording = simulate(workload(size, seed), seed)
            for name, estimator in contestants.items():
                progress.set_description(f"{name}, {size} landmarks", refresh=not progress.delay)
                run_estimator(name, estimator, recording.first(20))  # compiled code loaded, caches warm
                results[name][str(size)] = _figures(recording, *run_estimator(name, estimator, recording))
                progress.update()
    for name, by_size in results.items():
        for size, figures in by_size.items():
            if CAUSAL in results and name != CAUSAL and "median_s" in figures:
                figures[f"ratio_to_{CAUSAL}"] = figures["median_s"] / results[CAUSAL][size]["median_s"]
    exponents = {name: growth_exponent(by_size) for name, by_size in results.items()}
    return {**origin(None), "workload": WORKLOAD, "estimators": results, "growth_exponent": exponents}


def _figures(recording: Recording, estimate: Estimate, run_s: float) -> dict[str, float]:
    figures = {
        "mean_observations": len(recording.observation) / (recording.steps + 1),
        "run_s": run_s,
        "runs_per_second": 1.0 / run_s,
        "mean_s": run_s / recording.steps,
    }
    if estimate.seconds is None:
        return figures
    second_round = estimate.seconds[recording.steps // 2 :]
    return figures | {"median_s": float(np.median(second_round)), "p95_s": float(np.quantile(second_round, 0.95))}


def growth_exponent(by_size: dict[str, dict[str, float]]) -> float | None:
    """Return the least-squares slope of log(step time) over log(map size); None for a single size."""
    if len(by_size) < 2:
        return None
    sizes = np.log([float(size) for size in by_size])
    return float(np.polyfit(sizes, np.log([step_time(figures) for figures in by_size.values()]), 1)[0])


def step_time(figures: dict[str, float]) -> float:
    """Return the median step time [s]; the mean for an estimator that takes the whole recording."""
    return figures["median_s"] if "median_s" in figures else figures["mean_s"]


def bench_table(result: dict[str, Any]) -> Page:
    """Return the table of the result: step times against map size, whole runs, shares and ratios."""
    columns = {
        "median_s": ("median [ms]", 1e3, "{:.4f}"),
        "p95_s": ("p95 [ms]", 1e3, "{:.4f}"),
        "mean_s": ("mean [ms]", 1e3, "{:.4f}"),
        "runs_per_second": ("runs/s", 1.0, "{:.3g}"),
        f"ratio_to_{CAUSAL}": (f"x {CAUSAL}", 1.0, "{:.4f}"),
    }
    rows: list[list[str]] = []
    heads = [ESTIMATOR, Head("landmarks"), *(Head(title) for title, _, _ in columns.values())]
    for name, by_size in result["estimators"].items():
        for size, figures in by_size.items():
            cells = [
                cell(scale * figures[key] if key in figures else None, form)
                for key, (_, scale, form) in columns.items()
            ]
            rows.append([name, size, *cells])
    exponents = result["growth_exponent"].items()
    growth = [f"growth of {name}: landmarks^{cell(exponent, '{:.2f}')}" for name, exponent in exponents]
    return Page((f"workload: {result['workload']}", "", Table.of(heads, rows), *growth))
