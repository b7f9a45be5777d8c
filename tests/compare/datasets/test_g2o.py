"""Graphs of g2o, TORO, GTSAM and iSAM: the meaning of their lines, graphs that are paths, and written graphs."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge.arrays import Float
from slamgauge.compare.cli.main import main
from slamgauge.compare.datasets.g2o import read_g2o
from slamgauge.compare.datasets.g2o_writer import write_g2o
from slamgauge.compare.datasets.imported_log import Imported
from slamgauge.compare.storage.files import save
from slamgauge.errors import UserError
from slamgauge.graph_baseline import batch
from slamgauge.recording import Recording
from slamgauge.se2 import between, compose
from tests.reference.random_recordings import random_recording, recording_of
from tests.reference.robot_logs import G2O, TORO

GRAPH = G2O["graph.g2o"]
Read = Callable[..., Imported]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def of_text(text: str, **options: bool) -> Imported:
        path = tmp_path / "graph.g2o"
        path.write_text(text)
        return read_g2o(path, **options)

    return of_text


def test_graphs_of_g2o(read: Read):
    recording, truth, notes, _ = read(GRAPH)
    assert_array_equal(recording.odometry, [[1, 0, 0.1], [1, 0.1, 0.2]])
    information = np.array([[100, 10, 0], [10, 200, 0], [0, 0, 300]])
    assert_allclose(recording.odometry_cov[0] @ information, np.eye(3), atol=1e-14)
    assert_allclose(np.linalg.inv(recording.odometry_cov[1]), [[400, 0, 0], [0, 900, 30], [0, 30, 1600]], atol=1e-9)
    assert_array_equal(recording.observation_step, [0, 2])
    assert_array_equal(recording.observation, [[4, -1], [2, 1]])
    assert_allclose(recording.observation_cov[1] @ [[25, 5], [5, 16]], np.eye(2), atol=1e-14)
    assert_array_equal(recording.landmark, [4, 4])
    assert_array_equal(recording.prior_mean, [1, 2, 0.5])
    assert_array_equal(recording.prior_cov, 0.0)
    assert_array_equal(recording.stamps, [0, 1, 2])
    assert recording.sensor == "position"
    assert truth is None
    assert notes == ()


@pytest.mark.parametrize("z", [(-1.0, 0.1, -0.2), (0.5, -2.0, 3.1), (1.0, 0.0, 0.0)])
def test_graphs_of_toro_and_gtsam(z: tuple[float, ...], read: Read):
    """TORO has its own order of entries and edges from later to earlier poses; BR has sigmas, bearing first."""
    recording = read(TORO["graph.toro"].replace("-1 0.1 -0.2", " ".join(map(str, z)))).recording
    back = between(np.array(z), np.zeros(3))
    assert_allclose(recording.odometry, [back])
    information = np.array([[50, 1, 2], [1, 60, 3], [2, 3, 100]])
    columns = [compose(compose(np.array(z), 1e-6 * axis), back) / 1e-6 for axis in np.eye(3)]  # z exp(v) z^-1 by v
    Ad = np.column_stack(columns)
    assert_allclose(recording.odometry_cov[0], Ad @ np.linalg.inv(information) @ Ad.T, atol=1e-7)
    assert_array_equal(recording.observation, [[4.0, 0.5], [4.0, -0.5]])
    assert_allclose(recording.observation_cov[0], np.diag([0.2, 0.1]) ** 2)
    assert recording.sensor == "range-bearing"


def test_endings_of_isam_and_of_gtsam(read: Read):
    """The same noise as the square root of an information and as a covariance."""
    root = np.array([[10, 1, 2], [0, 20, 3], [0, 0, 50]])
    cov = np.linalg.inv(root.T @ root)
    forms = ("ODOMETRY 0 1 1 0 0.1 {}", "LANDMARK 0 3 2 1 {}")

    def graph(matrix: Float) -> str:
        upper = np.triu_indices(3)
        part = matrix[:2, :2] if not matrix[1, 0] else np.linalg.inv(root[:2, :2].T @ root[:2, :2])
        ends = (matrix[upper], part[np.triu_indices(2)])
        lines = [form.format(" ".join(map(repr, end.tolist()))) for form, end in zip(forms, ends, strict=True)]
        return "\n".join(lines)

    isam, gtsams = read(graph(root), isam=True).recording, read(graph(cov)).recording
    assert_allclose(isam.odometry_cov[0], cov, rtol=1e-12)
    assert_allclose(isam.odometry_cov, gtsams.odometry_cov, rtol=1e-12)
    assert_allclose(isam.observation_cov, gtsams.observation_cov, rtol=1e-12)


@pytest.mark.gtsam
def test_our_optimum_has_gtsams_cost_of_the_file(tmp_path: Path):
    """GTSAM reads our file of ranges and bearings: its error at our optimum is half our chi-square."""
    import gtsam

    recording = replace(uncorrelated(random_recording(7)[1]), prior_cov=np.zeros((3, 3)))
    path = tmp_path / "graph.g2o"
    write_g2o(path, recording)
    estimate = batch(read_g2o(path).recording)
    graph, _ = gtsam.readG2o(str(path), False)
    values = gtsam.Values()
    assert recording.landmark is not None
    first = int(recording.landmark.max()) + 1 if recording.landmark.min() <= recording.steps else 0
    for k, pose in enumerate(estimate.poses):
        values.insert(first + k, gtsam.Pose2(*pose))
    for name, place in zip(estimate.landmark_ids, estimate.landmarks, strict=True):
        values.insert(gtsam.symbol("l", int(name)), place)
    assert 2.0 * graph.error(values) == pytest.approx(estimate.chi_square, rel=1e-6)


# --- which graphs are paths ----------------------------------------------------------------------

LOOP = "EDGE_SE2 10 15 2 0 0.3 1 0 0 1 0 1\n"


def test_loop_edges_are_refused_or_dropped(read: Read):
    with pytest.raises(UserError, match=r"line 11: the edge between the poses 10 and 15 is not.*--drop-loop-edges"):
        read(GRAPH + LOOP)
    recording, _, notes, _ = read(GRAPH + LOOP + "ROBOTLASER1 0 1 2 3\n", drop_loop_edges=True)
    assert recording == read(GRAPH).recording
    others = "1 edges between poses that are not on the path are dropped"
    assert notes == (others, "1 laser scans (ROBOTLASER1) are left out")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("EDGE_SE2_XY 15 4 2 1 25 5 16\nEDGE_SE2_XY 10 4 4 -1 25 0 25\n", "", "no observation of a landmark in it"),
        ("EDGE_SE2 11 15", "EDGE_SE2 15 15", "no edge joins the poses 11 and 15; number the poses in the order of"),
        ("VERTEX_SE2 15 3", "VERTEX_SE2 99 3", "line 4: pose 99 is on no edge of the path"),
        ("EDGE_SE2_XY 15", "EDGE_SE2_XY 16", "line 9: pose 16 is on no edge of the path; correct the id"),
        ("EDGE_SE2_XY 15 4", "EDGE_SE2_XY 15 11", "line 9: vertex 11 is a pose, not a landmark"),
        ("FIX 10", "FIX", "line 6: has 1 words, not 2; write FIX i"),
        ("VERTEX_SE2 10 1 2", "VERTEX_SE2 10 nan 2", "line 2, column 3: 'nan' is not a finite number"),
        ("FIX 10", "FIX 10\nFIX 15", "line 7: more poses than the start are fixed"),
        ("100 10 0 200 0 300", "100 200 0 200 0 300", "line 8: the information matrix is not positive definite"),
        ("EDGE_SE2 10 11 1 0", "EDGE_SE2 10 11 1", "line 8: has 11 words, not 12; write EDGE_SE2 i j x y theta Ixx"),
        ("EDGE_SE2 10 11", "EDGE_SE2 10 99999999999999999", "line 8, column 3: '99999999999999999' is not an id"),
        ("EDGE_SE2_XY 10 4 4 -1 25 0 25", "BR 10 4 1 1 1 1", "a sensor of kind position, and others of kind range"),
        ("EDGE_SE2_XY 10", "EDGE_SE_XY 10", "line 10: 'EDGE_SE_XY' is an unknown tag; did you mean EDGE_SE2_XY?"),
        ("EDGE_SE2 1", "# EDGE_SE2 1", "no edge between poses in it"),
    ],
)
def test_wrong_graphs_are_refused_in_one_line(read: Read, tmp_path: Path, old: str, new: str, message: str):
    assert old in GRAPH
    with pytest.raises(UserError, match=r"^[^\n]+$") as caught:
        read(GRAPH.replace(old, new))
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "graph.g2o"))


# --- and back ----------------------------------------------------------------------------------


def uncorrelated(recording: Recording) -> Recording:
    """The recording with observations as BR has them."""
    return replace(recording, observation_cov=recording.observation_cov * np.eye(2))


@pytest.mark.parametrize("fixed", [True, False])
@pytest.mark.parametrize("sensor", ["range-bearing", "bearing", "position"])
def test_recordings_come_back_to_twelve_digits(tmp_path: Path, sensor: str, fixed: bool):
    recording = recording_of(sensor)
    recording = uncorrelated(recording) if sensor == "range-bearing" else recording
    recording = replace(recording, prior_cov=np.zeros((3, 3))) if fixed else recording
    write_g2o(tmp_path / "graph.g2o", recording)
    back = read_g2o(tmp_path / "graph.g2o").recording
    assert_array_equal(back.stamps, np.arange(recording.steps + 1))
    assert back.sensor == recording.sensor
    for name in ("prior_mean", "odometry", "observation", "observation_step", "landmark"):
        assert_allclose(getattr(back, name), getattr(recording, name), rtol=1e-12, atol=1e-12)
    for name in ("prior_cov", "odometry_cov", "observation_cov"):
        given, found = getattr(recording, name), getattr(back, name)
        assert_allclose(found, given, rtol=1e-12, atol=1e-12 * np.abs(given).max())


@pytest.mark.parametrize(
    ("recording", "message"),
    [
        (random_recording(8, slip=False)[1], r"odometry_cov\[0\]: is singular.*--lend 1e-4"),
        (random_recording(8)[1], r"observation_cov\[0\]: range and bearing are correlated"),
        (replace(random_recording(8)[1], landmark=None), r"landmark: a graph needs ids"),
        (replace(recording_of("position"), prior_cov=np.diag([0.1, 0.0, 0.0])), r"prior_cov\[0\]: is singular"),
    ],
)
def test_recordings_without_a_graph_are_refused_in_one_line(
    tmp_path: Path, recording: Recording, message: str, capsys: pytest.CaptureFixture[str]
):
    save(tmp_path / "recording.npz", recording)
    arguments = ["export", "g2o", str(tmp_path / "recording.npz"), "--out", str(tmp_path / "graph.g2o")]
    assert main(arguments) == 2
    told = capsys.readouterr().err
    assert re.fullmatch(rf"slamgauge: .*{message}.*\n", told)
    assert not (tmp_path / "graph.g2o").exists()


def test_regularising_noise_is_added_to_singular_motions(tmp_path: Path):
    recording = random_recording(9, sensor="position", slip=False)[1]
    write_g2o(tmp_path / "graph.g2o", recording, lend=1e-3)
    back = read_g2o(tmp_path / "graph.g2o").recording
    assert_allclose(back.odometry_cov, recording.odometry_cov + 1e-6 * np.eye(3), rtol=1e-9, atol=1e-15)
