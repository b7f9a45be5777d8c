"""Landmark logs of the DLR data set: the robot's forward is -Y there, and x here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge.arrays import Float
from slamgauge.compare.datasets.dlr import read_dlr
from slamgauge.compare.datasets.imported_log import Imported
from slamgauge.errors import UserError
from slamgauge.se2 import chain, compose
from tests.reference.robot_logs import DLR

LOG = DLR["log.txt"]
Read = Callable[..., Imported]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def of_text(text: str = LOG, **options: bool) -> Imported:
        path = tmp_path / "log.txt"
        path.write_text(text)
        return read_dlr(path, **options)

    return of_text


def test_frames_are_turned_and_covariances_with_them(read: Read):
    recording, truth, notes = read()
    assert_array_equal(recording.odometry, [[0.5, 0.1, 0.02], [0.4, 0.0, 0.0]])
    expected = [[4e-5, -1e-6, 3e-6], [-1e-6, 1e-5, 2e-6], [3e-6, 2e-6, 2e-4]]
    assert_allclose(recording.odometry_cov[0], expected, rtol=1e-12)
    assert_array_equal(recording.observation, [[3.1, -0.25], [2.7, -0.3]])
    assert_allclose(recording.observation_cov[0], [[0.0038, -0.0002], [-0.0002, 0.0017]], rtol=1e-12)
    assert_array_equal(recording.observation_step, [1, 2])
    assert_array_equal(recording.landmark, [4, 4])
    assert_array_equal(recording.stamps, [0, 1, 2])
    assert truth is None
    assert notes == ("1 of 3 observations have no id and are left out",)


def test_the_turned_log_is_the_same_drive(read: Read):
    """Landmarks from its own frame's path, turned by a quarter, are those of ours."""
    recording = read().recording
    quarter = np.array([0.0, 0.0, np.pi / 2])

    def seen_from(path: Float, sights: Float) -> Float:
        return compose(path, np.column_stack([sights, np.zeros(len(sights))]))[:, :2]

    theirs = chain(np.zeros(3), np.array([[0.1, -0.5, 0.02], [0.0, -0.4, 0.0]]))
    there = seen_from(theirs[[1, 2]], np.array([[-0.25, -3.1], [-0.3, -2.7]]))
    ours = chain(recording.prior_mean, recording.odometry)
    here = seen_from(ours[recording.observation_step], recording.observation)
    assert_allclose(here, seen_from(np.tile(quarter, (2, 1)), there), atol=1e-12)


def test_ids_can_be_forgotten_or_all_be_unknown(read: Read):
    for recording in (
        read(with_ids=False).recording,
        read(LOG.replace("0038 4", "0038 -1")).recording,
    ):
        assert recording.landmark is None
        assert_array_equal(recording.observation_step, [1, 1, 2])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("STEP largemap.0000", "STEP", "line 2: has 10 words, not 11; write STEP image dX"),
        ("LANDMARK -0.25", "LANDMARK_L -0.25", "line 3: 'LANDMARK_L' is neither STEP nor LANDMARK; remove the line"),
        ("-3.1 0.9", "x 0.9", "line 3: 'x' is no finite number"),
        (
            "0.0017 0.0002 0.0038",
            "0.0017 0.2 0.0038",
            "line 3: the covariance of the LANDMARK is not positive definite",
        ),
        ("1e-5 1e-6 4e-5", "1e-5 1e-6 0", "line 2: the covariance of the STEP is not positive semi-definite"),
        ("0.0038 4", "0.0038 -2", "line 3: '-2' is no id; give a whole number from -1"),
        (LOG, "# nothing\n", "no STEP line in it"),
    ],
)
def test_wrong_logs_are_refused_in_one_line(read: Read, old: str, new: str, message: str):
    with pytest.raises(UserError, match=r"^[^\n]+$") as caught:
        read(LOG.replace(old, new, 1))
    assert message in str(caught.value)
