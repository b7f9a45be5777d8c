"""Relative errors over distances, on paths whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest

from slamgauge import Estimate, Recording, Truth
from slamgauge.arrays import Float
from slamgauge.compare.scoring.relative_error import relative_errors
from slamgauge.se2 import compose


def recording_of(steps: int) -> Recording:
    return Recording(
        stamps=np.arange(steps + 1.0),
        prior_mean=np.zeros(3),
        prior_cov=np.eye(3),
        odometry=np.zeros((steps, 3)),
        odometry_cov=np.broadcast_to(np.eye(3), (steps, 3, 3)),
        sensor="range-bearing",
        observation_step=np.zeros(0, np.int64),
        observation=np.zeros((0, 2)),
        observation_cov=np.zeros((0, 2, 2)),
        landmark=np.zeros(0, np.int64),
    )


def found(reference: Float, poses: Float) -> list[tuple[float | None, ...]]:
    errors = relative_errors(Truth(poses=reference), recording_of(len(poses) - 1), Estimate("filtered", poses))
    assert errors is not None
    return [tuple(each.values()) for each in errors]


def straight(length: float, steps: int) -> Float:
    return np.column_stack([np.linspace(0.0, length, steps + 1), np.zeros((steps + 1, 2))])


def test_a_scale_error_grows_with_the_distance_and_a_turn_once_made_does_not():
    """21 poses 1 m apart; lengths are 2 % too large. Of a length d there are 21 - d pieces."""
    assert found(straight(20.0, 20), straight(20.4, 20)) == [
        (d, pytest.approx(0.02 * d), 0.0, 21 - d) for d in (1.0, 2.0, 5.0, 10.0)
    ]
    turned = straight(20.0, 20)
    turned[11:, 2] = 0.3  # one step has it
    for distance, _, turn, pieces in found(straight(20.0, 20), turned):
        assert distance
        assert pieces
        assert turn == pytest.approx(0.3 * np.sqrt(distance / pieces))


def test_where_the_world_lies_and_where_a_path_begins_changes_nothing():
    rng = np.random.default_rng(0)
    reference = np.cumsum(rng.normal(0.0, [0.5, 0.5, 0.1], (200, 3)), axis=0)
    poses = reference + rng.normal(0.0, 0.05, reference.shape)
    moved = compose([1e6, -2e6, 2.0], poses)
    for here, there in zip(found(reference, poses), found(reference, moved), strict=True):
        assert here == pytest.approx(there, rel=1e-6)


def test_gaps_of_the_truth_are_jumped_and_who_stands_still_goes_nowhere():
    gappy = straight(20.0, 20)
    gappy[5:8] = np.nan
    assert [pieces for *_, pieces in found(gappy, straight(20.0, 20))] == [17, 16, 13, 8]
    assert found(np.zeros((5, 3)), np.ones((5, 3))) == []
    assert relative_errors(Truth(), recording_of(4), Estimate("filtered", np.zeros((5, 3)))) is None
