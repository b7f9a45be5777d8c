"""A short study, a thread that carries it, and its figures."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from slamgauge.compare.scenarios.scenario import Scenario, load_scenario


@pytest.fixture
def scenario() -> Scenario:
    return load_scenario("q1-long-dense", ["start=sampled", "trajectory.duration=4"])


@pytest.fixture
def thread() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(1) as executor:
        yield executor


@pytest.fixture
def saved(monkeypatch: pytest.MonkeyPatch) -> dict[str, Figure]:
    """The figures that are saved during a test, by their names; they are not written."""
    figures: dict[str, Figure] = {}

    def keep(figure: Figure, path: Path) -> None:
        figures[path.name] = figure

    monkeypatch.setattr("slamgauge.compare.figures.plot_style.save_printed", keep)
    return figures
