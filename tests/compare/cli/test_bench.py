"""The bench: its workload and its figures, on a small map."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.cli.bench import growth_exponent, workload
from slamgauge.compare.cli.main import main
from slamgauge.compare.scenarios.trajectory import Segments

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("landmarks", "radius"), [(50, 10.0), (400, 20.0)])
def test_the_workload_is_the_one_described(landmarks: int, radius: float) -> None:
    scenario = workload(landmarks)
    assert isinstance(scenario.trajectory, Segments)
    (segment,) = scenario.trajectory.segments
    assert segment.speed / segment.yaw_rate == pytest.approx(radius)
    assert segment.duration * segment.yaw_rate == pytest.approx(4 * np.pi)
    positions = np.array(scenario.landmarks.positions) - [0.0, radius]
    assert len(positions) == landmarks
    distances = np.abs(np.hypot(*positions.T) - radius)
    assert distances.min() >= 0.5
    assert np.abs(positions).max() <= 15.0 if landmarks <= 300 else distances.max() <= 9.8


def test_growth_exponent_is_the_slope_of_a_power_law() -> None:
    figures = {str(size): {"median_s": 1e-6 * size**1.7} for size in (10, 40, 90)}
    assert growth_exponent(figures) == pytest.approx(1.7)
    assert growth_exponent({"10": {"median_s": 1.0}}) is None


def test_the_command_writes_table_json_and_figure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "bench"
    assert main(["bench", "--landmarks", "5,10", "--estimators", "ekf,riekf,batch", "--json", "--out", str(out)]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((out / "bench.json").read_text())
    assert (out / "bench.png").stat().st_size > 0
    assert (out / "bench.svg").stat().st_size > 0
    assert set(printed["estimators"]) == {"ekf", "riekf", "batch"}
    for name, by_size in printed["estimators"].items():
        assert set(by_size) == {"5", "10"}
        for figures in by_size.values():
            assert 0 < figures["mean_s"] < figures["run_s"]
            assert ("median_s" in figures) == (name != "batch")
            assert figures.get("median_s", 0.0) <= figures.get("p95_s", 0.0)


@pytest.mark.parametrize("words", [["--landmarks", "0"], ["--landmarks", "ten"], ["--estimators", "bach"]])
def test_bad_input_is_one_line_and_exit_2(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--landmarks", "5", *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1
