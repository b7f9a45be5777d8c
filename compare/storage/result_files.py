"""Names of the files that commands write, and the provenance that JSON files record."""

from __future__ import annotations

import shlex
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

from slamgauge.version import __version__

RECORDING, TRUTH = "recording.npz", "truth.npz"
MAPPING = "recording.toml"  # how the files of a log were read
METRICS = "metrics.json"
REPORT = "report.html"  # page that explains the results in its folder
STORE = "study.sqlite"
LOCK = "-lock"  # next to a store that a command writes to
SUMMARY = "summary.json"
SWEEP = "sweep.json"
OPTIMA = "optimum"  # folder of the stores of the optima, next to those of the values
BUDGET = "budget.json"
NOISE = "noise.json"
EXERCISE = "exercise.json"
STUDIES, RUN_0 = "studies", "run-0"  # folders of the stores, and of the results of run 0 of each setting
TWIN = "twin.toml"
TWIN_PATH, TWIN_MOTION, TWIN_SIGHTINGS = "path.csv", "motion.csv", "sightings.csv"
BENCH = "bench.json"
GRADES, RUBRIC = "grades.csv", "rubric.toml"
GRADESCOPE, RESULTS = "gradescope", "results.json"  # folder with a folder per submission, and its file
PAGES = "submissions"  # folder with a page per submission

_COMMAND: ContextVar[str | None] = ContextVar("_COMMAND", default=None)


@contextmanager
def commanded(words: Sequence[str]) -> Generator[None]:
    """Record `slamgauge WORDS` as the command of all results in the block."""
    token = _COMMAND.set(shlex.join(["slamgauge", *words]))
    try:
        yield
    finally:
        _COMMAND.reset(token)


def origin(scenario_text: str | None) -> dict[str, str | None]:
    """Return version, command and scenario for a JSON file; results of a Python program have no command.

    Args:
        scenario_text: The scenario as TOML, overrides included; None without a scenario.
    """
    return {"version": __version__, "command": _COMMAND.get(), "scenario_text": scenario_text}
