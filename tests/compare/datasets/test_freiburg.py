"""Logs of the course at Freiburg."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge.compare.datasets.freiburg import increment_jacobians, increments, read_freiburg
from slamgauge.errors import UserError
from slamgauge.se2 import compose
from tests.reference.jacobians import assert_jacobian
from tests.reference.robot_logs import FREIBURG


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in FREIBURG.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_the_whole_log(folder: Path):
    recording, truth, _ = read_freiburg(folder)
    turn, way = np.array([0.0, 0.0, 0.1]), np.array([2.0, 0.0, 0.0])
    assert_allclose(recording.odometry[0], compose(compose(turn, way), [0.0, 0.0, -0.3]), atol=1e-15)
    assert_array_equal(recording.odometry[1], [1, 0, 0])
    assert_allclose(recording.odometry_cov[1], [[1e-4, 0, 0], [0, 25e-6, 25e-6], [0, 25e-6, 50e-6]], atol=1e-18)
    assert_array_equal(recording.observation_step, [1, 1, 2])
    assert_allclose(recording.observation[1], [3.0, 4.0 - 2 * np.pi])
    assert_allclose(recording.observation_cov[0], 0.01 * np.eye(2))
    assert_array_equal(recording.prior_cov, 0.0)
    assert truth is not None
    assert truth.poses is None
    assert_array_equal(truth.landmark_ids, [1, 2, 3])
    assert_array_equal(truth.landmarks, [[2, 1], [0, 4], [9, 9]])
    assert_array_equal(truth.association, [1, 2, 1])


def test_the_world_may_be_missing(folder: Path):
    expected = read_freiburg(folder).recording
    (folder / "world.dat").unlink()
    recording, truth, _ = read_freiburg(folder / "sensor_data.dat")
    assert recording == expected
    assert truth is None


@pytest.mark.parametrize("at", [[0.1, 2.0, -0.3], [-3.1, 1.5, 3.1], [2.0, 0.0, 1.0], [0.0, -0.5, 0.0]])
def test_jacobian_of_the_three_parts(at: list[float]):
    def moved(motion: np.ndarray) -> np.ndarray:
        return increments(motion[None])[0]

    assert_jacobian(moved, increment_jacobians(np.array([at]))[0], at, angles=[2])


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("sensor_data.dat", "ODOMETRY 0.1", "ODOMETRIE 0.1", "line 1: 'ODOMETRIE' is neither ODOMETRY nor SENSOR"),
        ("sensor_data.dat", "SENSOR 1 2.0", "SENSOR 1 -2.0", "line 2: a range of -2.0 m; remove the line"),
        ("sensor_data.dat", "SENSOR 2 3.0", "SENSOR 8 3.0", "line 3: landmark 8 is not in world.dat"),
        ("sensor_data.dat", "ODOMETRY", "# ", "no ODOMETRY line in it"),
        ("world.dat", "2 0 4", "1 0 4", "world.dat, line 2: landmark 1 was there before"),
        ("world.dat", "2 0 4", "2 0", "world.dat, line 2: has 2 words, not 3; write id x y"),
    ],
)
def test_wrong_logs_are_refused_in_one_line(folder: Path, name: str, old: str, new: str, message: str):
    (folder / name).write_text(FREIBURG[name].replace(old, new))
    with pytest.raises(UserError, match=r"^[^\n]+$") as caught:
        read_freiburg(folder)
    assert message in str(caught.value)
