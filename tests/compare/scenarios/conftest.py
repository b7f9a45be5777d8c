"""A scenario file, the lines of its mistakes, and short simulations."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scenarios.trajectory import Segments
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.truth import Truth

FALSE_ALARM_RATE = 1e-4  # probability that a right simulator fails a statistical test
Write = Callable[[str], str]

GOOD = """
description = "a square's first side, and a turn"
[trajectory]
step = 0.1
segments = [{speed = 1.0, yaw_rate = 0.0, duration = 2.0}, {speed = 0.0, yaw_rate = 1.5, duration = 1.04}]
[motion]
sigma_speed = 0.1
sigma_yaw_rate_deg = 1
[sensor]
kind = "position"
max_range = 5
sigma_position = 0.2
[landmarks]
positions = [[1, 2], [3.5, -1]]
"""


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(text: str) -> str:
        path = tmp_path / "my.toml"
        path.write_text(text, encoding="utf-8")
        return str(path)

    return write


def segmented(scenario: Scenario) -> Segments:
    assert isinstance(scenario.trajectory, Segments)
    return scenario.trajectory


def mistakes(path: str, *overrides: str) -> list[str]:
    with pytest.raises(UserError) as caught:
        load_scenario(path, overrides)
    lines = str(caught.value).splitlines()
    assert all(line.startswith(f"{path}: ") for line in lines)
    return [line.removeprefix(f"{path}: ") for line in lines]


def run(*overrides: str, seed: int = 3) -> tuple[Truth, Recording]:
    return simulate(load_scenario("q1-short-dense", overrides), seed)
