"""Valid recordings, and parts of them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.reference.example_records import recording


@pytest.mark.parametrize("sensor", ["range-bearing", "bearing", "position"])
def test_a_recording_may_have_no_observations_and_no_steps(sensor: str) -> None:
    dim = 1 if sensor == "bearing" else 2
    empty = recording(
        stamps=[5.0],
        odometry=np.zeros((0, 3)),
        odometry_cov=np.zeros((0, 3, 3)),
        sensor=sensor,
        observation_step=[],
        observation=np.zeros((0, dim)),
        observation_cov=np.zeros((0, dim, dim)),
        landmark=[],
    )
    assert empty.steps == 0
    assert [len(scan.value) for scan in empty.scans()] == [0]


def test_ranges_may_be_zero_and_positions_negative() -> None:
    recording(observation=[[0.0, 0.0], [1.0, -4.0], [1.0, 9.0]])
    recording(sensor="position", observation=[[-1.0, 0.0], [1.0, -4.0], [0.0, 0.0]])


def test_scans_come_step_by_step() -> None:
    scans = list(recording(observation_step=[0, 2, 2]).scans())
    ids = [scan.landmark for scan in scans]
    assert [None if i is None else i.tolist() for i in ids] == [[4], [], [4, 9]]
    np.testing.assert_array_equal(scans[2].value, [[3.0, -0.2], [1.0, 3.1]])
    assert scans[2].cov.shape == (2, 2, 2)
    assert [scan.landmark for scan in recording(landmark=None).scans()] == [None, None, None]


def test_the_first_steps_are_a_recording() -> None:
    whole = recording(observation_step=[0, 1, 2])
    for steps in range(3):
        part = whole.first(steps)
        assert part.steps == steps
        np.testing.assert_array_equal(part.stamps, whole.stamps[: steps + 1])
        np.testing.assert_array_equal(part.odometry_cov, whole.odometry_cov[:steps])
        for ours, theirs in zip(part.scans(), list(whole.scans())[: steps + 1], strict=True):
            for actual, expected in zip(ours, theirs, strict=True):
                np.testing.assert_array_equal(actual, expected)
    assert recording(landmark=None).first(1).landmark is None


def test_observations_can_be_selected() -> None:
    whole = recording(observation_step=[0, 1, 2])
    part = whole.only(np.array([True, False, True]))
    np.testing.assert_array_equal(part.observation_step, [0, 2])
    np.testing.assert_array_equal(part.observation, whole.observation[[0, 2]])
    np.testing.assert_array_equal(part.observation_cov, whole.observation_cov[[0, 2]])
    assert part.landmark is not None
    assert whole.landmark is not None
    np.testing.assert_array_equal(part.landmark, whole.landmark[[0, 2]])
    np.testing.assert_array_equal(part.odometry, whole.odometry)
    assert recording(landmark=None).only(np.zeros(3, dtype=bool)).landmark is None
