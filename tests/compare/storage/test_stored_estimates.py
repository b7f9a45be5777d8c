"""Estimates in files: exact reading, and one-line errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.estimators.stored_trajectory import load_stored
from slamgauge.compare.storage.csv_folder import POSE, write_rows
from slamgauge.compare.storage.files import save
from slamgauge.compare.storage.trajectories import write_tum
from slamgauge.ekf import ekf_slam
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from tests.reference.random_recordings import random_recording

_, RECORDING = random_recording(0, steps=10)


@pytest.fixture(scope="module")
def estimate() -> Estimate:
    return ekf_slam(RECORDING)


def test_tum_with_and_without_covariances(estimate: Estimate, tmp_path: Path) -> None:
    path = tmp_path / "mine.tum"
    write_tum(path, RECORDING.stamps, estimate.poses)
    bare = load_stored(path, RECORDING).estimate
    np.testing.assert_allclose(bare.poses, estimate.poses, atol=1e-12)
    assert bare.pose_covs is None
    assert estimate.pose_covs is not None
    lines = path.read_text().splitlines()
    upper = np.triu_indices(3)
    for size, at in ((3, upper), (6, np.triu_indices(6))):
        covs = np.zeros((len(lines), size, size))
        rows = [0, 1, size - 1]
        covs[np.ix_(range(len(lines)), rows, rows)] = estimate.pose_covs
        more = [f"{line} {' '.join(map(repr, cov[at].tolist()))}" for line, cov in zip(lines, covs, strict=True)]
        path.write_text("# t x y z qx qy qz qw\n" + "\n".join(reversed(more)))
        found = load_stored(path, RECORDING).estimate.pose_covs
        assert found is not None
        np.testing.assert_allclose(found, estimate.pose_covs, atol=1e-15)


def test_npz_estimates_are_read_unchanged(estimate: Estimate, tmp_path: Path) -> None:
    save(tmp_path / "estimate.npz", estimate)
    assert load_stored(tmp_path / "estimate.npz", RECORDING).estimate == estimate


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0 0 0 0 0 0 0\n", "line 1: 7 columns; write 8, 14, 29 numbers"),
        ("0 0 0 0 0 0 0 one\n", "line 1, column 8: 'one' is not a finite number"),
        ("0 0 0 0 0 0 1e200 1\n", "line 1, column 7: '1e200' is not a finite number"),
        ("5 0 0 0 0 0 0 1\n", "no pose within 1 s of step 0"),
        ("", "no pose within 1 s of step 0"),
    ],
)
def test_wrong_tum_files_are_an_error(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "mine.tum"
    path.write_text(text)
    with pytest.raises(UserError, match=f"mine.tum.*{message}"):
        load_stored(path, RECORDING)


@pytest.mark.parametrize(
    ("quaternion", "message"),
    [
        ("0 0 0 2", r"pose 3: the quaternion qx qy qz qw has the length 2; write unit quaternions"),
        ("0 0 0 0", r"pose 3: the quaternion qx qy qz qw has the length 0;"),
        ("0 0 0.5 1", r"pose 3: .* has the length 1\.118;"),
    ],
)
def test_quaternions_of_another_length_are_an_error(
    estimate: Estimate, tmp_path: Path, quaternion: str, message: str
) -> None:
    path = tmp_path / "mine.tum"
    write_tum(path, RECORDING.stamps, estimate.poses)
    lines = path.read_text().splitlines()
    lines[3] = " ".join([*lines[3].split()[:4], quaternion])
    path.write_text("\n".join(lines))
    with pytest.raises(UserError, match=message):
        load_stored(path, RECORDING)


def test_tilted_poses_are_reported(estimate: Estimate, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Columns in the order qw qx qy qz look like a robot upside down."""
    path = tmp_path / "mine.tum"
    write_tum(path, RECORDING.stamps, estimate.poses)
    load_stored(path, RECORDING)
    assert "tilted" not in capsys.readouterr().err
    rows = [line.split() for line in path.read_text().splitlines()]
    path.write_text("\n".join(" ".join([*row[:4], row[7], *row[4:7]]) for row in rows))
    load_stored(path, RECORDING)
    assert "qx or qy is 0.98 at pose 0: the robot is tilted, or the columns are not in the order" in (
        capsys.readouterr().err
    )


@pytest.mark.parametrize("log", ["odometry.csv", "truth.csv", None])
def test_the_true_landmarks_of_a_log_are_not_the_map_of_an_estimate(
    estimate: Estimate, tmp_path: Path, log: str | None
) -> None:
    rows = [[step, *pose] for step, pose in enumerate(estimate.poses.tolist())]
    write_rows(tmp_path / "estimate.csv", ("step", "x", "y", "theta"), rows)
    write_rows(tmp_path / "landmarks.csv", ("landmark", "x", "y"), [[7, 1.0, 2.0]])
    if log is not None:
        (tmp_path / log).write_text("anything\n")
    found = load_stored(tmp_path / "estimate.csv", RECORDING).estimate
    assert found.landmark_ids.tolist() == ([7] if log is None else [])


def test_a_gap_of_more_than_a_second_has_no_pose(tmp_path: Path) -> None:
    rows = [[stamp, 0.0, 0.0, 0.0] for stamp in (0.0, 0.2, 1.3)]
    write_rows(tmp_path / "mine.csv", ("stamp", *POSE), rows)
    with pytest.raises(UserError, match=r"no pose within 1 s of step 3 at t = 0.300000 s, .* --max-gap 1.2 accepts it"):
        load_stored(tmp_path / "mine.csv", RECORDING)
    with pytest.raises(UserError, match=r"no pose within 1 s of step 0 .* --time-offset S shifts them$"):
        load_stored(tmp_path / "mine.csv", RECORDING, time_offset=100.0)
    found = load_stored(tmp_path / "mine.csv", RECORDING, max_gap=1.2)
    assert found.own is not None
    assert found.own.compared.nonzero()[0].tolist() == [0, 2]
