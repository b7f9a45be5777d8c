"""Logs of UTIAS: frames, noise, clocks and ids."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge.compare.datasets.imported_log import Imported
from slamgauge.compare.datasets.mrclam import read_mrclam
from slamgauge.errors import UserError
from tests.reference.given import given
from tests.reference.robot_logs import MRCLAM

Read = Callable[..., Imported]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Write files, and read them."""

    def written(files: dict[str, str], **options: Any) -> Imported:
        for file, text in files.items():
            (tmp_path / file).write_text(text)
        return read_mrclam(tmp_path, **options)

    return written


def test_the_log_begins_with_the_ground_truth(read: Read):
    recording, truth, notes, _, _ = read(MRCLAM)
    assert_array_equal(recording.stamps, [10.5, 11.0, 11.5, 12.0])
    truth = given(truth)
    poses = given(truth.poses)
    assert_array_equal(recording.prior_mean, poses[0])
    arc = 2 * np.pi - 6.2  # the shorter way from 3.1 to -3.1 rad
    assert_allclose(poses[0], [1 + 3 / 7, 2, 3.1 + arc * 3 / 7])
    assert_allclose(poses[3], [3, 2, -3.0])
    assert_array_equal(truth.landmark_ids, [6, 7])
    assert_array_equal(truth.association, [7])
    assert notes == (
        "1 lines of odometry are before the ground truth and are dropped",
        "1 observations are of other robots and are dropped",
        "1 observations have a barcode that is not in Barcodes.dat and are dropped",
        "2 observations outside the odometry's time are dropped, 67%: check units and clocks of the files",
    )


def test_velocities_are_valid_until_the_next_line_and_steps_are_split_at_observations(read: Read):
    recording = read(MRCLAM).recording
    chord = 0.15 * np.sinc(0.025 / np.pi)
    assert_allclose(recording.odometry[0], [chord * np.cos(0.025), chord * np.sin(0.025), 0.05])  # the second at 10.5 s
    assert_allclose(recording.odometry[1:, 2], [-0.1, -0.1])
    assert_allclose(recording.odometry_cov, np.tile(0.5 * np.diag([0.05, 0.01, 0.05]) ** 2, (3, 1, 1)))
    assert_array_equal(recording.observation_step, [2])
    assert_array_equal(recording.observation, [[3.0, -0.3]])
    assert_array_equal(recording.landmark, [7])


def test_without_ground_truth_the_start_is_the_origin(read: Read):
    files = {name: text for name, text in MRCLAM.items() if name != "Robot2_Groundtruth.dat"}
    recording, truth, _, _, _ = read(files, range_sigma=0.3, forward=0.2)
    assert truth is None
    assert_array_equal(recording.prior_mean, 0.0)
    assert_array_equal(recording.stamps, [10.0, 10.25, 10.5, 11.0, 11.5, 12.0])
    assert_array_equal(recording.landmark, [6, 7])
    assert_allclose(recording.observation_cov[0, 0, 0], 0.09)
    assert_allclose(recording.odometry_cov[0, 0, 0], 0.01)


def test_names_without_the_robot(read: Read, tmp_path: Path):
    expected = read(MRCLAM)
    for path in tmp_path.glob("Robot2_*"):
        path.rename(path.with_name(path.name.removeprefix("Robot2_")))
    assert read_mrclam(tmp_path).recording == expected.recording


def test_the_robot_must_be_given_if_there_are_several(read: Read):
    expected, files = read(MRCLAM), MRCLAM | {"Robot3_Odometry.dat": "0 0 0\n"}
    with pytest.raises(
        UserError, match=r": logs of several robots \(Robot2_.*, Robot3_.*\); .* choose a robot with --robot$"
    ):
        read(files)
    assert read(files, robot=2).recording == expected.recording


def test_noise_that_is_zero_is_refused(read: Read):
    with pytest.raises(UserError, match=r"observation_cov\[0\] = [^\n]* must be positive definite"):
        read(MRCLAM, range_sigma=0.0)


# --- mistakes ----------------------------------------------------------------------------------

ODOMETRY, MEASUREMENT, LANDMARKS = "Robot2_Odometry.dat", "Robot2_Measurement.dat", "Landmark_Groundtruth.dat"


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        (ODOMETRY, "1 0 0\n0 0 0\n", "Odometry.dat, line 2: stamp 0.000000000 is before that of the line above"),
        (ODOMETRY, "1 0\n", "Odometry.dat, line 1: has 2 words, not 3; write time velocity yaw-rate"),
        (ODOMETRY, "10.5 0 0\n", "Odometry.dat: fewer than two stamps"),
        (ODOMETRY, "90 0 0\n91 0 0\n", "Groundtruth.dat: no pose for any time of the odometry"),
        (ODOMETRY, "10.5 0 9\n11 0 0\n", "line 1: the robot turns by 4.5 rad in one row"),
        (MEASUREMENT, "11 63 -1 0\n", "Measurement.dat, line 1: the range is negative"),
        (MEASUREMENT, "# none\n", "Measurement.dat: no line in it"),
        ("Barcodes.dat", "6 6.5\n", "Barcodes.dat, line 1, column 2: '6.5' is not an id"),
        (LANDMARKS, "6 0 0 0 0\n6 0 0 0 0\n", "Landmark_Groundtruth.dat: landmark_ids[1] = 6"),
        (LANDMARKS, "6 0 0 0 0\n", "Landmark_Groundtruth.dat: association[0] = 7"),
    ],
)
def test_wrong_logs_are_refused_in_one_line(read: Read, name: str, text: str, message: str):
    with pytest.raises(UserError, match=r"^[^\n]+$") as caught:
        read(MRCLAM | {name: text})
    assert message in str(caught.value)
