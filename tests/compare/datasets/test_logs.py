"""Logs of the DLR data set, of the course at Freiburg and of UTIAS: frames, noise, clocks and ids."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge.arrays import Float
from slamgauge.compare.datasets.dlr import read_dlr
from slamgauge.compare.datasets.freiburg import increment_jacobians, increments, read_freiburg
from slamgauge.compare.datasets.imported_log import Imported
from slamgauge.compare.datasets.mrclam import read_mrclam
from slamgauge.errors import UserError
from slamgauge.se2 import chain, compose
from tests.reference.jacobians import assert_jacobian
from tests.reference.robot_logs import DLR, FREIBURG, MRCLAM

LOG = DLR["log.txt"]
Read = Callable[..., Imported]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Write files, and read them."""

    def written(reader: Read, files: dict[str, str], name: str = "", **options: object) -> Imported:
        for file, text in files.items():
            (tmp_path / file).write_text(text)
        return reader(tmp_path / name, **options)

    return written


# --- DLR ---------------------------------------------------------------------------------------


def test_frames_are_turned_and_covariances_with_them(read: Read):
    recording, truth, notes, _, _ = read(read_dlr, DLR, "log.txt")
    assert_array_equal(recording.odometry, [[0.5, 0.1, 0.02], [0.4, 0.0, 0.0]])
    expected = [[4e-5, -1e-6, 3e-6], [-1e-6, 1e-5, 2e-6], [3e-6, 2e-6, 2e-4]]
    assert_allclose(recording.odometry_cov[0], expected, rtol=1e-12)
    assert_array_equal(recording.observation, [[3.1, -0.25], [2.7, -0.3]])
    assert_allclose(recording.observation_cov[0], [[0.0038, -0.0002], [-0.0002, 0.0017]], rtol=1e-12)
    assert_array_equal(recording.observation_step, [1, 2])
    assert_array_equal(recording.landmark, [4, 4])
    assert_array_equal(recording.stamps, [0, 1, 2])
    assert truth is None
    assert notes == ("1 of 3 observations have no id and are dropped",)


def test_the_turned_log_is_the_same_drive(read: Read):
    """Landmarks on the path in DLR's frame, turned by a quarter, are those of our recording."""
    recording = read(read_dlr, DLR, "log.txt").recording
    quarter = np.array([0.0, 0.0, np.pi / 2])

    def positions(path: Float, observed: Float) -> Float:
        return compose(path, np.column_stack([observed, np.zeros(len(observed))]))[:, :2]

    theirs = chain(np.zeros(3), np.array([[0.1, -0.5, 0.02], [0.0, -0.4, 0.0]]))
    there = positions(theirs[[1, 2]], np.array([[-0.25, -3.1], [-0.3, -2.7]]))
    ours = chain(recording.prior_mean, recording.odometry)
    here = positions(ours[recording.observation_step], recording.observation)
    assert_allclose(here, positions(np.tile(quarter, (2, 1)), there), atol=1e-12)


@pytest.mark.parametrize(("text", "options"), [(LOG, {"with_ids": False}), (LOG.replace("0038 4", "0038 -1"), {})])
def test_ids_can_be_dropped_or_all_be_unknown(read: Read, text: str, options: dict[str, bool]):
    recording = read(read_dlr, {"log.txt": text}, "log.txt", **options).recording
    assert recording.landmark is None
    assert_array_equal(recording.observation_step, [1, 1, 2])


# --- Freiburg ----------------------------------------------------------------------------------


def test_a_log_of_freiburg(read: Read):
    recording, truth, _, _, _ = read(read_freiburg, FREIBURG)
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


def test_the_world_may_be_missing(read: Read, tmp_path: Path):
    expected = read(read_freiburg, FREIBURG).recording
    (tmp_path / "world.dat").unlink()
    assert read_freiburg(tmp_path / "sensor_data.dat") == Imported(expected)


@pytest.mark.parametrize("at", [[0.1, 2.0, -0.3], [-3.1, 1.5, 3.1], [2.0, 0.0, 1.0], [0.0, -0.5, 0.0]])
def test_jacobian_of_the_three_parts(at: list[float]):
    def moved(motion: np.ndarray) -> np.ndarray:
        return increments(motion[None])[0]

    assert_jacobian(moved, increment_jacobians(np.array([at]))[0], at, angles=[2])


# --- UTIAS -------------------------------------------------------------------------------------


def test_the_log_begins_with_the_ground_truth(read: Read):
    recording, truth, notes, _, _ = read(read_mrclam, MRCLAM)
    assert_array_equal(recording.stamps, [10.5, 11.0, 11.5, 12.0])
    assert truth is not None
    assert truth.poses is not None
    assert_array_equal(recording.prior_mean, truth.poses[0])
    arc = 2 * np.pi - 6.2  # the shorter way from 3.1 to -3.1 rad
    assert_allclose(truth.poses[0], [1 + 3 / 7, 2, 3.1 + arc * 3 / 7])
    assert_allclose(truth.poses[3], [3, 2, -3.0])
    assert_array_equal(truth.landmark_ids, [6, 7])
    assert_array_equal(truth.association, [7])
    assert notes == (
        "1 lines of odometry are before the ground truth and are dropped",
        "1 observations are of other robots and are dropped",
        "1 observations have a barcode that is not in Barcodes.dat and are dropped",
        "2 observations outside the odometry's time are dropped, 67%: check units and clocks of the files",
    )


def test_velocities_are_valid_until_the_next_line_and_steps_are_split_at_observations(read: Read):
    recording = read(read_mrclam, MRCLAM).recording
    chord = 0.15 * np.sinc(0.025 / np.pi)
    assert_allclose(recording.odometry[0], [chord * np.cos(0.025), chord * np.sin(0.025), 0.05])  # the second at 10.5 s
    assert_allclose(recording.odometry[1:, 2], [-0.1, -0.1])
    assert_allclose(recording.odometry_cov, np.tile(0.5 * np.diag([0.05, 0.01, 0.05]) ** 2, (3, 1, 1)))
    assert_array_equal(recording.observation_step, [2])
    assert_array_equal(recording.observation, [[3.0, -0.3]])
    assert_array_equal(recording.landmark, [7])


def test_without_ground_truth_the_start_is_the_origin(read: Read):
    files = {name: text for name, text in MRCLAM.items() if name != "Robot2_Groundtruth.dat"}
    recording, truth, _, _, _ = read(read_mrclam, files, range_sigma=0.3, forward=0.2)
    assert truth is None
    assert_array_equal(recording.prior_mean, 0.0)
    assert_array_equal(recording.stamps, [10.0, 10.25, 10.5, 11.0, 11.5, 12.0])
    assert_array_equal(recording.landmark, [6, 7])
    assert_allclose(recording.observation_cov[0, 0, 0], 0.09)
    assert_allclose(recording.odometry_cov[0, 0, 0], 0.01)


def test_names_without_the_robot(read: Read, tmp_path: Path):
    expected = read(read_mrclam, MRCLAM)
    for path in tmp_path.glob("Robot2_*"):
        path.rename(path.with_name(path.name.removeprefix("Robot2_")))
    assert read_mrclam(tmp_path).recording == expected.recording


def test_the_robot_must_be_given_if_there_are_several(read: Read):
    expected, files = read(read_mrclam, MRCLAM), MRCLAM | {"Robot3_Odometry.dat": "0 0 0\n"}
    with pytest.raises(UserError, match=r": logs of several robots; choose one of 2, 3 with --robot$"):
        read(read_mrclam, files)
    assert read(read_mrclam, files, robot=2).recording == expected.recording


def test_noise_that_is_zero_is_refused(read: Read):
    with pytest.raises(UserError, match=r"^range: 0 is not a standard deviation; give a number > 0$"):
        read(read_mrclam, MRCLAM, range_sigma=0.0)


# --- mistakes ----------------------------------------------------------------------------------

READERS: dict[str, tuple[Read, dict[str, str], str]] = {
    "log.txt": (read_dlr, DLR, "log.txt"),
    **dict.fromkeys(FREIBURG, (read_freiburg, FREIBURG, "")),
    **dict.fromkeys(MRCLAM, (read_mrclam, MRCLAM, "")),
}
ODOMETRY, MEASUREMENT, LANDMARKS = "Robot2_Odometry.dat", "Robot2_Measurement.dat", "Landmark_Groundtruth.dat"


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),  # an empty `old` is the whole file
    [
        ("log.txt", "STEP largemap.0000", "STEP", "line 2: has 10 words, not 11; write STEP image dX"),
        ("log.txt", "LANDMARK -0.25", "LANDMARK_L -0.25", "line 3: 'LANDMARK_L' is an unknown tag; did you mean"),
        ("log.txt", "-3.1 0.9", "x 0.9", "line 3: 'x' is not a finite number"),
        ("log.txt", "0.0017 0.0002", "0.0017 0.2", "line 3: the covariance of the LANDMARK is not positive definite"),
        ("log.txt", "1e-6 4e-5", "1e-6 0", "line 2: the covariance of the STEP is not positive semi-definite"),
        ("log.txt", "0.0038 4", "0.0038 -2", "line 3: '-2' is not an id; give a whole number from -1"),
        ("log.txt", "", "# nothing\n", "no STEP line in it"),
        ("sensor_data.dat", "ODOMETRY 0.1", "ODOMETRIE 0.1", "line 1: 'ODOMETRIE' is an unknown tag; did you mean"),
        ("sensor_data.dat", "SENSOR 2 3.0", "SENSOR 8 3.0", "line 3: landmark 8 is not in world.dat"),
        ("sensor_data.dat", "ODOMETRY", "# ", "no ODOMETRY line in it"),
        ("world.dat", "2 0 4", "1 0 4", "world.dat, line 2: landmark 1 was there before"),
        ("world.dat", "2 0 4", "2 0", "world.dat, line 2: has 2 words, not 3; write id x y"),
        (ODOMETRY, "", "1 0 0\n0 0 0\n", "Odometry.dat, line 2: stamp 0.000000000 comes after 1.0"),
        (ODOMETRY, "", "1 0\n", "Odometry.dat, line 1: has 2 words, not 3; write time velocity yaw-rate"),
        (ODOMETRY, "", "10.5 0 0\n", "Odometry.dat: fewer than two stamps"),
        (ODOMETRY, "", "90 0 0\n91 0 0\n", "Odometry.dat: no ground truth for any time in it"),
        (ODOMETRY, "", "10.5 0 9\n11 0 0\n", "line 1: the robot turns by 4.5 rad in one row"),
        (MEASUREMENT, "", "11 63 -1 0\n", "Measurement.dat, line 1: the range is negative"),
        (MEASUREMENT, "", "# none\n", "Measurement.dat: no line in it"),
        ("Barcodes.dat", "", "6 6.5\n", "Barcodes.dat, line 1: '6.5' is not an id"),
        (LANDMARKS, "", "6 0 0 0 0\n6 0 0 0 0\n", "Landmark_Groundtruth.dat: landmark_ids[1] = 6"),
        (LANDMARKS, "", "6 0 0 0 0\n", "Landmark_Groundtruth.dat: association[0] = 7"),
    ],
)
def test_wrong_logs_are_refused_in_one_line(read: Read, name: str, old: str, new: str, message: str):
    reader, files, place = READERS[name]
    text = files[name].replace(old, new) if old else new
    with pytest.raises(UserError, match=r"^[^\n]+$") as caught:
        read(reader, files | {name: text}, place)
    assert message in str(caught.value)
