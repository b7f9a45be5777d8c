"""Names of the files that commands write."""

from __future__ import annotations

from collections.abc import Iterable

LOCK = "-lock"  # next to a store that a command writes to


def pictures(*names: str) -> tuple[str, ...]:
    """Return the png and svg file names of figures."""
    return tuple(f"{name}.{ending}" for name in names for ending in ("png", "svg"))


RECORDING, TRUTH = "recording.npz", "truth.npz"
MAPPING = "recording.toml"  # how the files of a log were read
METRICS = "metrics.json"
RUN_PICTURES = pictures("figure", "consistency", "rays")
REPORT = "report.html"  # page that explains the results in its folder
OUTDATED = ("estimates/*.npz", "trajectories/*.tum", "animation.*")  # files of an earlier run

STORE = "study.sqlite"
SUMMARY = "summary.json"
STUDY_PICTURES = pictures("nees", "nis", "rmse", "errors", "ratios")
SWEEP = "sweep.json"
SWEEP_PICTURES = pictures("sweep")
OPTIMA = "optimum"  # folder of the stores of the optima, next to those of the values
SWEEP_FILES = (SWEEP, *SWEEP_PICTURES, REPORT)
BUDGET = "budget.json"
BUDGET_FILES = (BUDGET, *pictures("budget"), REPORT)
NOISE = "noise.json"
NOISE_FILES = (NOISE, *pictures("noise"), REPORT)
EXERCISE = "exercise.json"
STUDIES, RUN_0 = "studies", "run-0"  # folders of the stores, and of the results of run 0 of each setting
TWIN = "twin.toml"
TWIN_PATH, TWIN_MOTION, TWIN_SIGHTINGS = "path.csv", "motion.csv", "sightings.csv"
TWIN_FILES = (TWIN, TWIN_PATH, TWIN_MOTION, TWIN_SIGHTINGS)
BENCH = "bench.json"
BENCH_FILES = (BENCH, *pictures("bench"))

GRADES, RUBRIC = "grades.csv", "rubric.toml"
GRADESCOPE, RESULTS = "gradescope", "results.json"  # folder with a folder per submission, and its file
PAGES = "submissions"  # folder with a page per submission


def exercise_files(questions: Iterable[str], figures: Iterable[str]) -> list[str]:
    """Return every file that the exercise writes next to its stores and run folders."""
    pictures = [f"{name}-{what}.png" for name in questions for what in ("nees", "closures")]
    return [EXERCISE, REPORT, *pictures, *(f"figure-{each}.png" for each in figures)]


def grade_files(submissions: Iterable[str]) -> list[str]:
    """Return every file that grading submissions of these names writes."""
    names = [*submissions]
    pages = [f"{PAGES}/{name}.html" for name in names]
    results = [f"{GRADESCOPE}/{name}/{RESULTS}" for name in names] + [RESULTS] * (len(names) == 1)
    return [GRADES, RUBRIC, REPORT, *pages, *results]


def comparison_files(estimators: Iterable[str]) -> list[str]:
    """Return every file that a run of these estimators may write."""
    each = [file for name in estimators for file in (f"estimates/{name}.npz", f"trajectories/{name}.tum")]
    return [RECORDING, TRUTH, *each, "trajectories/truth.tum", *RUN_PICTURES, METRICS, REPORT]
