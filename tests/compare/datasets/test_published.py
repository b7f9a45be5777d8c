"""Published recordings: frames, noise, clocks and ids, the counts that descriptions state, and refusals of one line."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import loadmat, savemat

from slamgauge.arrays import Float
from slamgauge.compare.cli.main import main
from slamgauge.compare.datasets.g2o import read_g2o
from slamgauge.compare.datasets.imported_log import Imported
from slamgauge.compare.datasets.published import read_lost_in_the_woods, read_mrclam
from slamgauge.compare.storage.files import load_recording
from slamgauge.errors import UserError
from slamgauge.se2 import between, compose, rotation, wrap
from tests.reference.given import given
from tests.reference.robot_logs import MRCLAM, WOODS

DATA = Path(__file__).parents[3] / "../shared/data"
VICTORIA_PARK = DATA / "victoria_park/victoria_park.txt"
LOST_IN_THE_WOODS = DATA / "lost_in_the_woods/dataset2.mat"
needs_victoria_park = pytest.mark.skipif(not VICTORIA_PARK.exists(), reason=f"{VICTORIA_PARK} is not there")
needs_lost_in_the_woods = pytest.mark.skipif(not LOST_IN_THE_WOODS.exists(), reason=f"{LOST_IN_THE_WOODS} is not there")
PARK = """\
ODOMETRY 0 1 1 0 0.5 1e-4 0 0 4e-6 0 4e-6
ODOMETRY 1 3 2 0 0 1e-4 1e-6 2e-6 4e-6 3e-7 4e-6
LANDMARK 3 2 3 4 0.4 0.1 0.5

LANDMARK 0 2 6 8 0.4 0 0.4
"""


@needs_victoria_park
def test_victoria_park_has_the_stated_counts():
    recording = read_g2o(VICTORIA_PARK).recording
    assert (recording.sensor, recording.steps, len(recording.observation)) == ("position", 6968, 3640)
    assert len(np.unique(given(recording.landmark))) == 151
    for fixed in (recording.prior_mean, recording.prior_cov, recording.stamps - np.arange(6969)):
        assert_array_equal(fixed, 0.0)
    assert_array_equal(recording.odometry_cov - np.diag([1e-4, 4e-6, 4e-6]), 0.0)
    assert_array_equal(recording.observation_cov - 0.4 * np.eye(2), 0.0)
    assert_array_equal(recording.observation[0], [11.5387, -3.2007])  # LANDMARK 4 5 11.5387 -3.2007
    assert (recording.observation_step[0], given(recording.landmark)[0]) == (4, 5)


def test_observations_out_of_range_are_dropped_from_victoria_park(tmp_path: Path):
    (tmp_path / "park.txt").write_text(PARK)
    words = ["import", "victoria-park", str(tmp_path / "park.txt"), "--max-range", "9", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    assert_array_equal(load_recording(tmp_path / "out/recording.npz").observation, [[3, 4]])


# --- Lost in the Woods -------------------------------------------------------------------------

DAMAGED = "not a whole dataset2.mat of Lost in the Woods"


def woods(path: Path, **changes: Any) -> Imported:
    """Read a small log with changed fields; None leaves a field out."""
    savemat(path / "woods.mat", {k: v for k, v in (WOODS | changes).items() if v is not None}, do_compression=True)
    return read_lost_in_the_woods(path / "woods.mat")


def test_woods_move_the_body_frame_to_the_sensor_with_its_noise(tmp_path: Path):
    log = woods(tmp_path)
    recording, poses = log.recording, given(given(log.truth).poses)
    to_sensor, small = np.array([0.5, 0.0, 0.0]), 1e-6

    def sensor_increment(noise: Float) -> Float:
        robot = 0.1 * (np.array([2.0, 0.0, 3.0]) + noise)  # dt (v, lateral slip, omega)
        return between(to_sensor, compose(robot, to_sensor))

    assert_allclose(recording.odometry, np.tile(sensor_increment(np.zeros(3)), (3, 1)), atol=1e-15)
    columns = [(sensor_increment(small * e) - sensor_increment(-small * e)) / (2 * small) for e in np.eye(3)]
    J = np.column_stack(columns)
    assert_allclose(recording.odometry_cov[0], J @ np.diag([0.01, 0.02**2, 0.04]) @ J.T, atol=1e-12)
    assert_allclose(poses[[0, 1, 3]], np.tile([1, 2.5, np.pi / 2], (3, 1)), atol=1e-15)
    assert_array_equal(np.isnan(poses[:, 0]), [False, False, True, False])
    assert_array_equal(recording.prior_mean, poses[0])
    assert_array_equal(recording.prior_cov, 0.0)


def test_woods_observations(tmp_path: Path):
    recording, truth, *_ = woods(tmp_path)
    assert_array_equal(recording.observation_step, [0, 3])
    assert_allclose(recording.observation, [[1, 4 - 2 * np.pi], [5, 4 - 2 * np.pi]])
    assert_array_equal(recording.observation_cov[1], np.diag([0.1, 0.2]))
    assert_array_equal(recording.landmark, [0, 0])
    assert_array_equal(given(truth).association, [0, 0])
    assert_array_equal(given(given(truth).landmarks), [[7, 8]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"v": None}, f"{DAMAGED} ('v')"),
        ({"v": np.ones((3, 1))}, "field v must be (4, 1) finite numbers; correct it"),
        ({"om": np.full((4, 1), np.nan)}, "field om must be (4, 1) finite"),
        ({"d": "half"}, DAMAGED),
        ({"om": np.full((4, 1), 1 + 1e-9j)}, DAMAGED),
        ({"t": {"a": 1}}, DAMAGED),
        ({"v": np.full((4, 1), 1e60)}, "field v must be (4, 1) finite"),
        ({"true_valid": np.zeros((4, 1))}, "true_valid: has no poses"),
        ({"true_valid": np.array([[0], [1], [1], [1]])}, "start.pose: the ground truth has no pose at the start"),
        ({"t": np.ones((4, 1))}, "stamps[1]"),
    ],
)
def test_malformed_woods_are_refused_with_their_field(tmp_path: Path, changes: dict[str, Any], message: str):
    with pytest.raises(UserError, match=r"woods.mat: [^\n]+$") as caught:
        woods(tmp_path, **changes)
    assert message in str(caught.value)


def test_files_that_are_not_compressed_matlab_files(tmp_path: Path):
    path, without_checksums = tmp_path / "woods.mat", BytesIO()
    savemat(without_checksums, WOODS)
    for content in (b"", b"t v om\n", without_checksums.getvalue()):
        path.write_bytes(content)
        with pytest.raises(UserError, match=rf"woods.mat: {DAMAGED} [^\n]*$"):
            read_lost_in_the_woods(path)


@needs_lost_in_the_woods
def test_lost_in_the_woods_has_the_stated_counts_and_fits_its_truth():
    recording, truth, *_ = read_lost_in_the_woods(LOST_IN_THE_WOODS)
    truth, raw = given(truth), loadmat(LOST_IN_THE_WOODS)
    path, places = given(truth.poses), given(truth.landmarks)
    assert recording.steps == 12608
    assert len(recording.observation) == np.sum((raw["r"] > 0) & (raw["r"] <= 5.0)) == 58135
    assert places.shape == (17, 2)
    assert np.isnan(path).any(axis=1).sum() == np.sum(raw["true_valid"] == 0)
    poses = path[recording.observation_step]
    body = np.einsum("nji,nj->ni", rotation(poses[:, 2]), places[given(recording.landmark)] - poses[:, :2])
    ranges = recording.observation[:, 0] - np.linalg.norm(body, axis=1)
    bearings = wrap(recording.observation[:, 1] - np.arctan2(body[:, 1], body[:, 0]))
    spread = np.nanstd([ranges, bearings], axis=1)
    assert_allclose(spread, np.sqrt(np.diag(recording.observation_cov[0])), rtol=0.02)
    assumed = np.sqrt(np.diagonal(recording.odometry_cov, axis1=1, axis2=2).mean(axis=0))
    assert_allclose(np.nanstd(recording.odometry - between(path[:-1], path[1:]), axis=0), assumed, rtol=0.15)


# --- UTIAS -------------------------------------------------------------------------------------

ODOMETRY, MEASUREMENT, LANDMARKS = "Robot2_Odometry.dat", "Robot2_Measurement.dat", "Landmark_Groundtruth.dat"
Read = Callable[..., Imported]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Write files, and read them."""

    def written(files: dict[str, str], **options: Any) -> Imported:
        for file, text in files.items():
            (tmp_path / file).write_text(text)
        return read_mrclam(tmp_path, **options)

    return written


def test_the_log_begins_with_the_ground_truth_and_velocities_are_valid_until_the_next_line(read: Read):
    recording, truth, notes, _ = read(MRCLAM)
    assert_array_equal(recording.stamps, [10.5, 11.0, 11.5, 12.0])
    poses = given(given(truth).poses)
    assert_array_equal(recording.prior_mean, poses[0])
    arc = 2 * np.pi - 6.2  # the shorter way from 3.1 to -3.1 rad
    assert_allclose(poses[0], [1 + 3 / 7, 2, 3.1 + arc * 3 / 7])
    assert_allclose(poses[3], [3, 2, -3.0])
    assert_array_equal(given(truth).landmark_ids, [6, 7])
    assert_array_equal(given(truth).association, [7])
    assert notes == (
        "1 rows of odometry before the first true pose are left out",
        "2 observations of other robots or unknown barcodes are dropped",
        "2 observations outside the odometry's time are dropped, 67%: check units and clocks of the files",
    )
    chord = 0.15 * np.sinc(0.025 / np.pi)
    assert_allclose(recording.odometry[0], [chord * np.cos(0.025), chord * np.sin(0.025), 0.05])  # the second at 10.5 s
    assert_allclose(recording.odometry[1:, 2], [-0.1, -0.1])
    assert_allclose(recording.odometry_cov, np.tile(0.5 * np.diag([0.05, 0.01, 0.05]) ** 2, (3, 1, 1)))
    assert_array_equal(recording.observation_step, [2])
    assert_array_equal(recording.observation, [[3.0, -0.3]])


def test_without_ground_truth_the_start_is_the_origin(read: Read):
    files = {name: text for name, text in MRCLAM.items() if name != "Robot2_Groundtruth.dat"}
    recording, truth, *_ = read(files, range_sigma=0.3, forward=0.2)
    assert truth is None
    assert_array_equal(recording.prior_mean, 0.0)
    assert_array_equal(recording.stamps, [10.0, 10.25, 10.5, 11.0, 11.5, 12.0])
    assert_array_equal(recording.landmark, [6, 7])
    assert_allclose((recording.observation_cov[0, 0, 0], recording.odometry_cov[0, 0, 0]), (0.09, 0.01))


def test_the_robot_must_be_given_if_there_are_several(read: Read):
    files = MRCLAM | {"Robot3_Odometry.dat": "0 0 0\n"}
    with pytest.raises(UserError, match=r": logs of several robots \(Robot2_.*, Robot3_.*\); .* with --robot$"):
        read(files)
    assert read(files, robot=2).recording.steps == 3


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        (ODOMETRY, "1 0 0\n0 0 0\n", "Odometry.dat, line 2: stamp 0.000000000 is before that of the line above"),
        (ODOMETRY, "1 0\n", "Odometry.dat, line 1: has 2 words, not 3; write time velocity yaw-rate"),
        (ODOMETRY, "10.5 0 0\n", "Odometry.dat: fewer than two stamps"),
        (ODOMETRY, "90 0 0\n91 0 0\n", "Groundtruth.dat: no pose for any time of the odometry"),
        (MEASUREMENT, "11 63 -1 0\n", "Measurement.dat, line 1: the range is negative"),
        ("Barcodes.dat", "6 6.5\n", "Barcodes.dat, line 1, column 2: '6.5' is not an id"),
        (LANDMARKS, "6 0 0 0 0\n", "Landmark_Groundtruth.dat: association[0] = 7"),
    ],
)
def test_wrong_logs_are_refused_in_one_line(read: Read, name: str, text: str, message: str):
    with pytest.raises(UserError, match=r"^[^\n]+$") as caught:
        read(MRCLAM | {name: text})
    assert message in str(caught.value)


def test_sigmas_that_are_zero_or_negative_are_refused(read: Read, tmp_path: Path):
    with pytest.raises(UserError, match=r"observation_cov\[0\] = [^\n]* must be positive definite"):
        read(MRCLAM, range_sigma=0.0)
    with pytest.raises(UserError, match=r"^bearing: -0\.05 is not a standard deviation; [^\n]+$"):
        read(MRCLAM, bearing_sigma=-0.05)
    with pytest.raises(UserError, match=r"^lateral_slip: -1 is not a standard deviation; [^\n]+$"):
        read_lost_in_the_woods(tmp_path / "woods.mat", lateral_slip=-1.0)
