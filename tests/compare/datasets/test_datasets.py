"""Published recordings: the counts that their descriptions state, and one-line refusals of damaged files."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.sparse import csc_matrix

from slamgauge.arrays import Float
from slamgauge.compare.datasets.g2o import read_victoria_park
from slamgauge.compare.datasets.lost_in_the_woods import read_lost_in_the_woods
from slamgauge.recording import Recording
from slamgauge.se2 import between, compose, rotation, wrap
from slamgauge.truth import Truth
from tests.reference.given import given

DATA = Path(__file__).parents[3] / "../shared/data"
VICTORIA_PARK = DATA / "victoria_park/victoria_park.txt"
LOST_IN_THE_WOODS = DATA / "lost_in_the_woods/dataset2.mat"
needs_victoria_park = pytest.mark.skipif(not VICTORIA_PARK.exists(), reason=f"{VICTORIA_PARK} is not there")
needs_lost_in_the_woods = pytest.mark.skipif(not LOST_IN_THE_WOODS.exists(), reason=f"{LOST_IN_THE_WOODS} is not there")

Write = Callable[[str], Path]

PARK = """\
ODOMETRY 0 1 1 0 0.5 1e-4 0 0 4e-6 0 4e-6
ODOMETRY 1 3 2 0 0 1e-4 1e-6 2e-6 4e-6 3e-7 4e-6
LANDMARK 3 2 3 4 0.4 0.1 0.5

LANDMARK 0 2 6 8 0.4 0 0.4
"""
NO_IDS = (str(10**20), str(2**53), "1" * 5000)


# --- Victoria Park -----------------------------------------------------------------------------


@needs_victoria_park
def test_victoria_park_has_the_stated_counts():
    recording = read_victoria_park(VICTORIA_PARK)
    assert recording.steps == 6968
    assert len(recording.observation) == 3640
    assert len(np.unique(given(recording.landmark))) == 151
    assert recording.sensor == "position"
    np.testing.assert_array_equal(recording.prior_mean, 0.0)
    np.testing.assert_array_equal(recording.prior_cov, 0.0)
    np.testing.assert_array_equal(recording.stamps, np.arange(6969))
    np.testing.assert_array_equal(recording.odometry_cov - np.diag([1e-4, 4e-6, 4e-6]), 0.0)
    np.testing.assert_array_equal(recording.observation_cov - 0.4 * np.eye(2), 0.0)
    np.testing.assert_array_equal(recording.observation[0], [11.5387, -3.2007])  # LANDMARK 4 5 11.5387 -3.2007
    assert (recording.observation_step[0], given(recording.landmark)[0]) == (4, 5)


@pytest.fixture
def park(tmp_path: Path) -> Write:
    def write(text: str) -> Path:
        path = tmp_path / "park.txt"
        path.write_text(text)
        return path

    return write


def test_park_edges_are_chained_and_observations_sorted(park: Write):
    recording = read_victoria_park(park(PARK))
    np.testing.assert_array_equal(recording.odometry, [[1, 0, 0.5], [2, 0, 0]])
    np.testing.assert_array_equal(
        recording.odometry_cov[1], [[1e-4, 1e-6, 2e-6], [1e-6, 4e-6, 3e-7], [2e-6, 3e-7, 4e-6]]
    )
    np.testing.assert_array_equal(recording.observation_step, [0, 2])
    np.testing.assert_array_equal(recording.observation, [[6, 8], [3, 4]])
    np.testing.assert_array_equal(recording.observation_cov[1], [[0.4, 0.1], [0.1, 0.5]])
    np.testing.assert_array_equal(recording.landmark, [2, 2])


def test_park_observations_out_of_range_are_dropped(park: Write):
    np.testing.assert_array_equal(read_victoria_park(park(PARK), max_range=9.0).observation, [[3, 4]])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("ODOMETRY 1 3", "ODOMETRY 2 3", "line 2: no edge joins the poses 1 and 2"),
        ("ODOMETRY 1 3", "ODOMETRY 1 0", "line 2: a second edge between the poses 1 and 0"),
        ("LANDMARK 3 2", "LANDMARK 4 2", "line 3: pose 4 is on no edge of the path; correct the id"),
        ("LANDMARK 3 2 3", "LANDMARK 3 2", "line 3: has 7 words, not 8; write LANDMARK i l x y cxx cxy cyy"),
        ("LANDMARK 3 2", "LANDMARK 3 -2", "line 3, column 3: '-2' is not an id"),
        ("ODOMETRY 0 1 1", "ODOMETRY 0 1 one", "line 1, column 4: 'one' is not a finite number"),
        ("ODOMETRY 0 1 1", "ODOMETRY 0 1 nan", "line 1, column 4: 'nan' is not a finite number"),
        *(("LANDMARK 3 2", f"LANDMARK 3 {name}", f"line 3, column 3: '{name[:40]}' is not a") for name in NO_IDS),
        *(("ODOMETRY 0 1", f"ODOMETRY 0 {name}", f"line 1, column 3: '{name[:40]}' is not a") for name in NO_IDS),
        ("LANDMARK 0", "BEACON 0", "line 5: 'BEACON' is an unknown tag"),
        ("0.4 0.1 0.5", "0.4 0.1 -0.5", "line 3: the covariance is not positive definite"),
        (PARK, "", "no edge between poses in it"),
        (PARK, "\x00\xff", "line 1: not a text"),
    ],
)
def test_malformed_parks_are_refused_with_their_line(park: Write, old: str, new: str, message: str):
    path = park(PARK.replace(old, new, 1))
    with pytest.raises(ValueError, match=r"^[^\n]+$") as caught:
        read_victoria_park(path)
    assert re.match(rf"{path}[:,] {re.escape(message)}", str(caught.value))


# --- Lost in the Woods -------------------------------------------------------------------------


def woods(**changes: Any) -> dict[str, Any]:
    """Four steps of a robot that turns by 0.3 rad while it drives 0.2 m, with one landmark."""
    column = np.ones((4, 1))
    fields = {"t": 0.1 * np.arange(4.0)[:, None], "v": 2.0 * column, "om": 3.0 * column, "d": 0.5}
    fields |= {"x_true": column, "y_true": 2 * column, "th_true": np.pi / 2 * column}
    fields |= {"true_valid": np.array([[1], [1], [0], [1]], dtype=np.uint8)}
    fields |= {"r": np.array([[1.0], [0.0], [9.0], [5.0]]), "b": 4.0 * column, "l": [[7.0, 8.0]]}
    fields |= {"r_var": 0.1, "b_var": 0.2, "v_var": 0.01, "om_var": 0.04}
    return {name: value for name, value in (fields | changes).items() if value is not None}


DAMAGED = "not a whole dataset2.mat of Lost in the Woods"
EMPTY = ("v", "om", "x_true", "y_true", "th_true", "true_valid", "r", "b")  # columns of the steps, except t


def read(path: Path, **changes: Any) -> tuple[Recording, Truth]:
    savemat(path / "woods.mat", woods(**changes))
    return read_lost_in_the_woods(path / "woods.mat")


def test_woods_move_the_body_frame_to_the_sensor(tmp_path: Path):
    recording, truth = read(tmp_path)
    to_sensor = np.array([0.5, 0.0, 0.0])
    expected = between(to_sensor, compose([0.2, 0.0, 0.3], to_sensor))
    np.testing.assert_allclose(recording.odometry, np.tile(expected, (3, 1)), atol=1e-15)
    np.testing.assert_allclose(given(truth.poses)[[0, 1, 3]], np.tile([1, 2.5, np.pi / 2], (3, 1)), atol=1e-15)
    np.testing.assert_array_equal(np.isnan(given(truth.poses)[:, 0]), [False, False, True, False])
    np.testing.assert_array_equal(recording.prior_mean, given(truth.poses)[0])
    np.testing.assert_array_equal(recording.prior_cov, 0.0)


def test_woods_carry_the_odometry_noise_to_the_sensor(tmp_path: Path):
    recording, _ = read(tmp_path)
    to_sensor, small = np.array([0.5, 0.0, 0.0]), 1e-6

    def sensor_increment(noise: Float) -> Float:
        robot = 0.1 * (np.array([2.0, 0.0, 3.0]) + noise)  # dt (v, lateral slip, omega)
        return between(to_sensor, compose(robot, to_sensor))

    columns = [(sensor_increment(small * e) - sensor_increment(-small * e)) / (2 * small) for e in np.eye(3)]
    jacobian = np.column_stack(columns)
    expected = jacobian @ np.diag([0.01, 0.02**2, 0.04]) @ jacobian.T
    np.testing.assert_allclose(recording.odometry_cov[0], expected, atol=1e-12)


def test_woods_observations(tmp_path: Path):
    recording, truth = read(tmp_path)
    np.testing.assert_array_equal(recording.observation_step, [0, 3])
    np.testing.assert_allclose(recording.observation, [[1, 4 - 2 * np.pi], [5, 4 - 2 * np.pi]])
    np.testing.assert_array_equal(recording.observation_cov[1], np.diag([0.1, 0.2]))
    np.testing.assert_array_equal(recording.landmark, [0, 0])
    np.testing.assert_array_equal(truth.association, [0, 0])
    np.testing.assert_array_equal(given(truth.landmarks), [[7, 8]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"v": None}, f"{DAMAGED} ('v')"),
        ({"v": np.ones((3, 1))}, "field v must be (4, 1) finite real numbers; correct it"),
        ({"r": np.ones((4, 2))}, "field r must be (4, 1) finite"),
        ({"om": np.full((4, 1), np.nan)}, "field om must be (4, 1) finite"),
        ({"d": "half"}, "field d must be (1, 1) finite"),
        ({"r": csc_matrix(np.eye(4)[:, :1])}, "field r must be (4, 1) finite"),
        ({"om": np.full((4, 1), 1 + 1e-9j)}, "field om must be (4, 1) finite"),
        ({"t": {"a": 1}}, "field t must be (1, 1) finite"),
        ({"t": np.ones((4, 1, 2))}, "field t must be (4, 1) finite"),
        (
            {"t": np.zeros((0, 1))} | dict.fromkeys(EMPTY, np.zeros((0, 1))),
            "field t must be (0, 1) finite",
        ),
        ({"v": np.full((4, 1), 1e60)}, "field v must be (4, 1) finite"),
        ({"true_valid": np.zeros((4, 1))}, "true_valid: no ground truth at the first step"),
        ({"t": np.ones((4, 1))}, "stamps[1]"),
    ],
)
def test_malformed_woods_are_refused_with_their_field(tmp_path: Path, changes: dict[str, Any], message: str):
    with pytest.raises(ValueError, match=r"woods.mat: [^\n]+$") as caught:
        read(tmp_path, **changes)
    assert message in str(caught.value)


def test_files_that_are_not_matlab_files(tmp_path: Path):
    path = tmp_path / "woods.mat"
    savemat(path, woods())
    whole = path.read_bytes()
    for content in (b"", b"t v om\n", whole[:500]):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"woods.mat: not a whole dataset2.mat [^\n]*$"):
            read_lost_in_the_woods(path)


@needs_lost_in_the_woods
def test_lost_in_the_woods_has_the_stated_counts():
    recording, truth = read_lost_in_the_woods(LOST_IN_THE_WOODS)
    raw = loadmat(LOST_IN_THE_WOODS)
    assert recording.steps == 12608
    assert len(recording.observation) == np.sum((raw["r"] > 0) & (raw["r"] <= 5.0)) == 58135
    assert given(truth.landmarks).shape == (17, 2)
    assert np.isnan(given(truth.poses)).any(axis=1).sum() == np.sum(raw["true_valid"] == 0)
    np.testing.assert_allclose(np.diff(recording.stamps), 0.1, rtol=1e-9)
    everything, _ = read_lost_in_the_woods(LOST_IN_THE_WOODS, max_range=np.inf)
    assert len(everything.observation) == np.sum(raw["r"] > 0)


@needs_lost_in_the_woods
def test_lost_in_the_woods_measurements_fit_the_truth():
    recording, truth = read_lost_in_the_woods(LOST_IN_THE_WOODS)
    poses = given(truth.poses)[recording.observation_step]
    offsets = given(truth.landmarks)[given(recording.landmark)] - poses[:, :2]
    body = np.einsum("nji,nj->ni", rotation(poses[:, 2]), offsets)
    ranges = recording.observation[:, 0] - np.linalg.norm(body, axis=1)
    bearings = wrap(recording.observation[:, 1] - np.arctan2(body[:, 1], body[:, 0]))
    spread = np.nanstd([ranges, bearings], axis=1)
    np.testing.assert_allclose(spread, np.sqrt(np.diag(recording.observation_cov[0])), rtol=0.02)
    motion = recording.odometry - between(given(truth.poses)[:-1], given(truth.poses)[1:])
    assumed = np.sqrt(np.diagonal(recording.odometry_cov, axis1=1, axis2=2).mean(axis=0))
    np.testing.assert_allclose(np.nanstd(motion, axis=0), assumed, rtol=0.15)
