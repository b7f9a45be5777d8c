"""Step times of this computer against map size: `slamgauge bench`.

Medians are over the second round, when the map is complete.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from slamgauge import memory
from slamgauge.compare.cli.common import Estimators, split_names, staged
from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.estimators import loading, running
from slamgauge.compare.estimators.registry import BENCHED, CAUSAL
from slamgauge.compare.figures import publishing
from slamgauge.compare.scenarios import scenario, simulation
from slamgauge.compare.scoring import table
from slamgauge.compare.storage import progress
from slamgauge.compare.storage.result_files import BENCH, origin
from slamgauge.errors import UserError

WORKLOAD = (
    "circle, 1 m/s, two rounds, 0.1 s steps, range 10 m, the exercise's noise, known association; "
    "up to 300 landmarks: radius 10 m, landmarks uniform in a 30 x 30 m box; "
    "above: radius 20 m, landmarks uniform within 9.8 m of the circle; none nearer to it than 0.5 m"
)
COPIES = 3.0  # memory for a filter, in copies of its covariance
LONGEST = 12  # digits of a map size: Python parses some thousands


@dataclass
class Command:
    """Measure step times for several map sizes, next to a plain numpy filter (the four default sizes take 20 minutes).

    For example:
      slamgauge bench --landmarks 20,100 --estimators ekf,riekf

    Attributes:
        landmarks: Comma-separated map sizes.
        out: Folder of bench.json, bench.png and bench.svg. Without it they are not written.
    """

    landmarks: str = "20,100,300,1000"
    estimators: Estimators = BENCHED
    out: Path | None = None
    output: Output = field(default_factory=Output)

    def run(self) -> int:
        words = [word.strip() for word in self.landmarks.split(",")]
        if not all(word.isdecimal() and len(word) <= LONGEST and int(word) > 0 for word in words):
            raise UserError(f"landmarks {self.landmarks!r:.60}: give map sizes > 0, for example 20,100")
        sizes = [int(word) for word in words]
        with staged(self.out, BENCH) as folder:
            result = run_bench(sizes, split_names(self.estimators))
            self.output.show(result, bench_table(result), folder and folder / BENCH)
        return 0 if self.out is None or publishing.draw_stored(self.out, BENCH) else 1


def workload(landmarks: int) -> scenario.Scenario:
    """Return the scenario of the bench with that many landmarks."""
    radius, reach, furthest = (10.0, 15.0, np.inf) if landmarks <= 300 else (20.0, 29.8, 9.8)
    drawn = np.random.default_rng(0).uniform(-reach, reach, (10 * landmarks, 2))
    distance = np.abs(np.hypot(*drawn.T) - radius)
    positions = np.array([0.0, radius]) + drawn[(distance >= 0.5) & (distance <= furthest)][:landmarks]
    path = f"trajectory.yaw_rate={1.0 / radius}", f"trajectory.duration={4.0 * np.pi * radius}"
    return scenario.load_scenario("q1-long-dense", [*path, f"landmarks.positions={positions.tolist()}"])


def run_bench(sizes: Sequence[int], names: Sequence[str]) -> dict[str, Any]:
    """Measure every estimator on every map size, unless a covariance does not fit into memory."""
    for size in sizes:
        what = f"landmarks: the covariance of {size}"
        memory.require_memory(COPIES * 8.0 * (3.0 + 2.0 * size) ** 2, what, "give a smaller map")
    contestants = loading.load_estimators(names)
    results: dict[str, dict[str, dict[str, float]]] = {name: {} for name in contestants}
    with progress.counted(len(sizes) * len(contestants), "run") as bar:
        for size in sizes:
            _, recording = simulation.simulate(workload(size), 0)
            for name, estimator in contestants.items():
                bar.set_description(f"{name}, {size} landmarks", refresh=not bar.delay)
                running.run_estimator(name, estimator, recording.first(20))  # compiled code loaded, caches warm
                estimate, run_s = running.run_estimator(name, estimator, recording)
                results[name][str(size)] = times = {
                    "mean_observations": len(recording.observation) / (recording.steps + 1),
                    "run_s": run_s,
                    "runs_per_second": 1.0 / run_s,
                    "mean_s": run_s / recording.steps,
                }
                if estimate.seconds is not None:
                    second_round = estimate.seconds[recording.steps // 2 :]
                    times["median_s"] = float(np.median(second_round))
                    times["p95_s"] = float(np.quantile(second_round, 0.95))
                bar.update()
    for name, by_size in results.items():
        for size, times in by_size.items():
            if CAUSAL in results and name != CAUSAL and "median_s" in times:
                times[f"ratio_to_{CAUSAL}"] = times["median_s"] / results[CAUSAL][size]["median_s"]
    exponents = {name: growth_exponent(by_size) for name, by_size in results.items()}
    return {**origin(None), "workload": WORKLOAD, "estimators": results, "growth_exponent": exponents}


def growth_exponent(by_size: dict[str, dict[str, float]]) -> float | None:
    """Return the least-squares slope of log(step time) over log(map size); None for a single size."""
    if len(by_size) < 2:
        return None
    times = [figures.get("median_s") or figures["mean_s"] for figures in by_size.values()]
    return float(np.polyfit(np.log([float(size) for size in by_size]), np.log(times), 1)[0])


def bench_table(result: dict[str, Any]) -> table.Page:
    """Return the table of the result: step times against map size, whole runs, shares and ratios."""
    columns = {
        "median_s": ("median [ms]", 1e3, "{:.4f}"),
        "p95_s": ("p95 [ms]", 1e3, "{:.4f}"),
        "mean_s": ("mean [ms]", 1e3, "{:.4f}"),
        "runs_per_second": ("runs/s", 1.0, "{:.3g}"),
        f"ratio_to_{CAUSAL}": (f"x {CAUSAL}", 1.0, "{:.4f}"),
    }
    heads = [table.ESTIMATOR, table.Head("landmarks"), *(table.Head(title) for title, _, _ in columns.values())]
    rows: list[list[str]] = []
    for name, by_size in result["estimators"].items():
        for size, times in by_size.items():
            shown = ((scale * times[key] if key in times else None, form) for key, (_, scale, form) in columns.items())
            rows.append([name, size, *(table.cell(*each) for each in shown)])
    exponents = result["growth_exponent"].items()
    growth = [f"growth of {name}: landmarks^{table.cell(exponent, '{:.2f}')}" for name, exponent in exponents]
    return table.Page((f"workload: {result['workload']}", "", table.Table.of(heads, rows), *growth))
