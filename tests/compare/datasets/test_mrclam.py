"""UTIAS logs of one robot: clocks, subjects, ground truth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge.compare.datasets.imported_log import Imported
from slamgauge.compare.datasets.mrclam import read_mrclam
from slamgauge.errors import UserError
from tests.reference.robot_logs import MRCLAM

Read = Callable[..., Imported]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def with_changes(changes: dict[str, str | None] | None = None, **options: float) -> Imported:
        for name, text in (MRCLAM | (changes or {})).items():
            if text is not None:
                (tmp_path / name).write_text(text)
        return read_mrclam(tmp_path, **options)  # pyright: ignore[reportArgumentType]

    return with_changes


def test_the_log_begins_with_the_ground_truth(read: Read):
    recording, truth, notes = read()
    assert_array_equal(recording.stamps, [10.5, 11.0, 11.5, 12.0])
    assert truth is not None
    assert truth.poses is not None
    assert_array_equal(recording.prior_mean, truth.poses[0])
    arc = 2 * np.pi - 6.2  # from 3.1 to -3.1 rad the shorter way
    assert_allclose(truth.poses[0], [1 + 3 / 7, 2, 3.1 + arc * 3 / 7])
    assert_allclose(truth.poses[3], [3, 2, -3.0])
    assert_array_equal(truth.landmark_ids, [6, 7])
    assert_array_equal(truth.association, [7])
    assert notes == (
        "1 lines of odometry are before the ground truth and left out",
        "1 observations are of other robots and are left out",
        "1 observations have a barcode that Barcodes.dat does not know and are left out",
        "2 observations outside the odometry's time are left out",
    )


def test_commands_are_in_force_until_the_next_and_split_where_something_is_seen(read: Read):
    recording = read().recording
    chord = 0.15 * np.sinc(0.025 / np.pi)
    assert_allclose(recording.odometry[0], [chord * np.cos(0.025), chord * np.sin(0.025), 0.05])  # the second of 10.5 s
    assert_allclose(recording.odometry[1:, 2], [-0.1, -0.1])
    assert_allclose(recording.odometry_cov, np.tile(0.5 * np.diag([0.05, 0.01, 0.05]) ** 2, (3, 1, 1)))
    assert_array_equal(recording.observation_step, [2])
    assert_array_equal(recording.observation, [[3.0, -0.3]])
    assert_array_equal(recording.landmark, [7])


def test_without_ground_truth_the_start_is_the_origin(read: Read):
    recording, truth, _ = read({"Robot2_Groundtruth.dat": None}, range_sigma=0.3, forward=0.2)
    assert truth is None
    assert_array_equal(recording.prior_mean, 0.0)
    assert_array_equal(recording.stamps, [10.0, 10.25, 10.5, 11.0, 11.5, 12.0])
    assert_array_equal(recording.landmark, [6, 7])
    assert_allclose(recording.observation_cov[0, 0, 0], 0.09)
    assert_allclose(recording.odometry_cov[0, 0, 0], 0.01)


def test_names_without_the_robot(tmp_path: Path, read: Read):
    expected = read()
    for path in tmp_path.glob("Robot2_*"):
        path.rename(path.with_name(path.name.removeprefix("Robot2_")))
    assert read_mrclam(tmp_path).recording == expected.recording


def test_the_robot_must_be_said_where_there_are_several(read: Read):
    expected = read()
    with pytest.raises(UserError, match=r": logs of several robots; choose one of 2, 3 with --robot$"):
        read({"Robot3_Odometry.dat": "0 0 0\n"})
    assert read(robot=2).recording == expected.recording


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("Robot2_Odometry.dat", "1 0 0\n0 0 0\n", "Odometry.dat, line 2: stamp 0.000000000 comes after 1.0"),
        ("Robot2_Odometry.dat", "1 0\n", "Odometry.dat, line 1: has 2 words, not 3; write time velocity yaw-rate"),
        ("Robot2_Odometry.dat", "10.5 0 0\n", "Odometry.dat: fewer than two moments"),
        ("Robot2_Odometry.dat", "90 0 0\n91 0 0\n", "Odometry.dat: no ground truth for any time in it"),
        ("Robot2_Odometry.dat", "10.5 0 9\n11 0 0\n", "line 1: the robot turns by 4.5 rad within a row"),
        ("Robot2_Measurement.dat", "11 63 -1 0\n", "Measurement.dat, line 1: the range is negative"),
        ("Robot2_Measurement.dat", "# none\n", "Measurement.dat: no line in it"),
        ("Barcodes.dat", "6 6.5\n", "Barcodes.dat, line 1: '6.5' is no id"),
        ("Landmark_Groundtruth.dat", "6 0 0 0 0\n6 0 0 0 0\n", "Landmark_Groundtruth.dat: landmark_ids[1] = 6"),
        ("Landmark_Groundtruth.dat", "6 0 0 0 0\n", "Landmark_Groundtruth.dat: association[0] = 7"),
    ],
)
def test_wrong_files_are_refused_in_one_line(read: Read, name: str, text: str, message: str):
    with pytest.raises(UserError, match=r"^[^\n]+$") as caught:
        read({name: text})
    assert message in str(caught.value)


def test_noise_that_is_none_is_refused(read: Read):
    with pytest.raises(UserError, match=r"^range: 0 is no standard deviation; give a number > 0$"):
        read(range_sigma=0.0)
