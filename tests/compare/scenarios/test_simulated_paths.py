"""Kinds of simulated paths and of random maps."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.studies.store import digest
from slamgauge.recording import Recording
from slamgauge.se2 import wrap

from .conftest import run


def moved(trajectory: str, *overrides: str) -> tuple[Float, Recording]:
    truth, recording = run("start=mean", f"trajectory={trajectory}", *overrides)
    assert truth.poses is not None
    return truth.poses, recording


def test_waypoints_are_reached_exactly_and_speeds_are_limited() -> None:
    points = "[[2.03, 0], [2.03, 0], [2, 1], [0, 0]]"
    path, recording = moved(
        f"{{kind='waypoints', step=0.1, points={points}, speed=0.5, yaw_rate=1}}", "prior.mean=[0, 0, 0.3]"
    )
    for point in ([2.03, 0.0], [2.0, 1.0], [0.0, 0.0]):
        assert np.linalg.norm(path[:, :2] - point, axis=1).min() < 1e-12
    steps = np.diff(path, axis=0)
    assert 0.045 < np.linalg.norm(steps[:, :2], axis=1).max() <= 0.05 + 1e-12
    assert 0.09 < np.abs(wrap(steps[:, 2])).max() <= 0.1 + 1e-12
    np.testing.assert_allclose(recording.stamps, 0.1 * np.arange(len(path)), atol=1e-12)


def test_a_figure_eight_returns_to_the_start_twice_per_lap() -> None:
    path, _ = moved("{kind='figure-eight', step=0.1, radius=3, speed=1, laps=2}")
    np.testing.assert_allclose(path[-1], 0.0, atol=1e-12)
    back = np.flatnonzero(np.linalg.norm(path[:, :2], axis=1) < 1e-9)
    assert len(back) == 5
    assert (path[:, 1].max(), path[:, 1].min()) == pytest.approx((6.0, -6.0), abs=0.01)


def test_a_path_of_a_file_keeps_its_poses_and_stamps(tmp_path: Path) -> None:
    (tmp_path / "path.csv").write_text("stamp,x,y,theta\n5,1,2,3\n5.5,1.5,2,-3\n6.5,2,2.5,-2\n")
    (tmp_path / "my.toml").write_text(
        "extends = 'q1-short-dense'\nprior = {mean = [1, 2, 3]}\n[trajectory]\nkind = 'csv'\nfile = 'path.csv'\n"
    )
    scenario = load_scenario(tmp_path / "my.toml", ["start=mean"])
    truth, recording = simulate(scenario, 0)
    assert truth.poses is not None
    np.testing.assert_allclose(truth.poses, [[1, 2, 3], [1.5, 2, -3], [2, 2.5, -2]], atol=1e-12)
    np.testing.assert_array_equal(recording.stamps, [5, 5.5, 6.5])
    np.testing.assert_allclose(np.sqrt(recording.odometry_cov[:, 0, 0]), [0.15, 0.3])
    assert scenario.trajectory.step == 0.75

    elsewhere = tmp_path / "elsewhere"
    shutil.copytree(tmp_path, elsewhere, ignore=shutil.ignore_patterns("elsewhere"))
    assert load_scenario(elsewhere / "my.toml", ["start=mean"]) == scenario
    assert digest(load_scenario(elsewhere / "my.toml", ["start=mean"]), 0) == digest(scenario, 0)
    (elsewhere / "path.csv").write_text("stamp,x,y,theta\n5,1,2,3\n5.5,1.5,2,-3\n6.5,2,2.5,-2.1\n")
    assert digest(load_scenario(elsewhere / "my.toml", ["start=mean"]), 0) != digest(scenario, 0)


def test_random_landmarks_are_the_same_map_in_every_run() -> None:
    chosen = "landmarks={random={count=40, box=[-5, 0, 5, 20], seed=4, min_distance=1}}"
    (one, _), (other, _) = run(chosen), run(chosen, seed=9)
    np.testing.assert_array_equal(one.landmarks, other.landmarks)
    assert one.landmarks is not None
    apart = np.linalg.norm(one.landmarks[:, None] - one.landmarks, axis=2)[np.triu_indices(40, 1)]
    assert apart.min() >= 1.0
    assert (one.landmarks >= [-5, 0]).all()
    assert (one.landmarks <= [5, 20]).all()
    more = run(chosen.replace("40", "41"))[0].landmarks
    assert more is not None
    np.testing.assert_array_equal(more[:40], one.landmarks)
