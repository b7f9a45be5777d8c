"""Small folders of each kind of results, some with malicious names, without figures and pages."""

from __future__ import annotations

import csv
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from slamgauge import compare_estimators, find_noise, load_estimators, load_scenario, simulate
from slamgauge.compare.cli.main import main
from slamgauge.compare.exercise import results
from slamgauge.compare.exercise.results import run_exercise
from slamgauge.compare.figures.publishing import write_study
from slamgauge.compare.grading.grades import FIGURES
from slamgauge.compare.noise.noise_json import noise_json
from slamgauge.compare.report.exercise_page import publish_exercise, publish_first_runs
from slamgauge.compare.scoring.comparison import metrics, write_comparison
from slamgauge.compare.storage.files import write_json
from slamgauge.compare.storage.staged_folder import begin_folder
from slamgauge.compare.studies.budget import RUNGS, summarise_budget
from slamgauge.compare.studies.study import load_runs, run_study
from tests.reference import fast_commands

SCRIPT_NAME, USER_NAME = "<script>alert(1)</script>", 'own "<b>&amp;'
SHORT = ["start=sampled", "trajectory.duration=5"]


def run(folder: Path, scenario: str = "q4-ring") -> None:
    """Write a run, by default bearing-only with rays."""
    begin_folder(folder)
    truth, recording = simulate(load_scenario(scenario, ["start=sampled", "trajectory.duration=30"]), 0)
    named = {"dead-reckoning": "dead-reckoning", "ekf": "ekf", USER_NAME: "riekf", "causal": "causal"}
    comparison = compare_estimators(truth, recording, load_estimators(named, frames=240))
    write_comparison(folder, comparison, metrics(comparison, SCRIPT_NAME, 0))


def ranges(folder: Path) -> None:
    run(folder, "q1-long-dense")


def study(folder: Path) -> None:
    """Write a study of four short runs."""
    begin_folder(folder)
    scenario, chosen = load_scenario("q1-short-dense", SHORT), ["ekf", "causal", "batch"]
    with ThreadPoolExecutor(1) as executor, fast_commands.empty_pictures():
        summary = run_study(scenario, 4, 0, chosen, folder, executor, against=["ekf"])
        runs = load_runs(scenario, 4, 0, chosen, folder)
        assert write_study(folder, summary, runs, scenario.trajectory.step)


def sweep(folder: Path) -> None:
    """Write a sweep with two short runs at each of two scales."""
    words = ["study", "q1-short-dense", "--runs", "2", "--jobs", "1", "--set", "trajectory.duration=3"]
    words += ["--estimators", "ekf,causal", "--sweep", "assumed.scale=1,2", "--out", str(folder)]
    with fast_commands.studies_in_a_thread(), fast_commands.empty_pictures():
        assert main(words) == 0


def budget(folder: Path) -> None:
    """Write an error budget."""
    begin_folder(folder)
    errors = np.random.default_rng(0).uniform(1.0, 2.0, (5, len(RUNGS)))
    found = summarise_budget(SCRIPT_NAME, "ekf", errors, np.full(errors.shape, np.nan), np.ones(len(errors)))
    write_json(folder / "budget.json", found.to_json())


def noise(folder: Path) -> None:
    """Write the noise of a log whose assumed noise is too large."""
    begin_folder(folder)
    log = simulate(load_scenario("q1-short-dense", [*SHORT, "assumed.scale=4"]), 2)[1]
    write_json(folder / "noise.json", noise_json(find_noise(log)))


def bench(folder: Path) -> None:
    """Write step times."""
    begin_folder(folder)
    times = {str(size): {"median_s": 1e-6 * size**1.5, "p95_s": 2e-6 * size**1.5} for size in (20, 1000)}
    write_json(folder / "bench.json", {"estimators": dict.fromkeys(("ekf", "causal", "plain-numpy"), times)})


def grades(folder: Path) -> None:
    """Write the grade of a submission."""
    begin_folder(folder)
    name = 'a "<b>'
    row = {"submission": name, "passed": "false", "graded": "true", "reason": f"{SCRIPT_NAME}; two"}
    row |= {"points": "47", "max_points": "100", "remarks": 'same "<i>" figures', "settings": "Q of the file <b>"}
    row |= {"failed_checks": "heading-wrap", "seconds_per_run": "0.5", "seed": "7", "digest": "of q1-long-dense"}
    row |= {f"{head.key}{end}": "" for head in FIGURES for end in ("", "_low", "_high")} | {"ate_m": "0.3"}
    with (folder / "grades.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, row)
        table.writeheader()
        table.writerow(row)
    item = {
        "name": "heading-wrap",
        "score": 0.0,
        "max_score": 3.0,
        "output": f"the wrap {SCRIPT_NAME}",
        "status": "failed",
    }
    content = {"score": 47.0, "max_score": 100.0, "output": f"{SCRIPT_NAME}\ntwo", "tests": [item]}
    (folder / "gradescope" / name).mkdir(parents=True)
    extra = {"remarks": ['same "<i>" figures'], "printed": SCRIPT_NAME}
    write_json(folder / "gradescope" / name / "results.json", {**content, "extra_data": extra})


def exercise(folder: Path) -> None:
    """Write question 3 with two short runs, with its pages."""
    begin_folder(folder)
    with ThreadPoolExecutor(1) as pool, pytest.MonkeyPatch.context() as patched, fast_commands.empty_pictures():
        patched.setattr(results, "load_scenario", lambda name: load_scenario(name, ["trajectory.duration=4"]))
        ran = run_exercise(["q3"], 2, 0, folder, pool)
        publish_first_runs(ran.settings, 0, folder, pool)
        assert publish_exercise(folder, ran)


WRITE: dict[str, Callable[[Path], None]] = {
    each.__name__: each for each in (run, ranges, study, sweep, budget, noise, bench, grades, exercise)
}
