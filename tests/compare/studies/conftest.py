"""A short study, a thread that runs it, and its results."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from slamgauge.compare.estimators.requests import Chosen
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.compare.studies.summary import Summary


def figures_of(summary: Summary) -> dict[str, Any]:
    """Return the content of summary.json without computing times."""
    content = summary.to_json()
    for entry in content["estimators"].values():
        del entry["seconds_total"]
    return content


@pytest.fixture
def scenario() -> Scenario:
    return load_scenario("q1-long-dense", ["start=sampled", "trajectory.duration=4"])


@pytest.fixture
def thread() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(1) as executor:
        yield executor


@pytest.fixture
def run(scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path) -> Callable[..., Summary]:
    """`run_study` of the scenario in `tmp_path`, or in a folder in it, by default in one thread with seed 0."""

    def run(
        runs: int, names: Chosen, where: str = "", seed: int = 0, executor: Executor = thread, **options: Any
    ) -> Summary:
        return run_study(options.pop("scenario", scenario), runs, seed, names, tmp_path / where, executor, **options)

    return run


@pytest.fixture
def load(scenario: Scenario, tmp_path: Path) -> Callable[..., dict[str, Runs]]:
    """`load_runs` of a study of `run`."""

    def load(runs: int, names: Chosen, where: str = "") -> dict[str, Runs]:
        return load_runs(scenario, runs, 0, names, tmp_path / where)

    return load
