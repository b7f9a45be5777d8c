"""Relative errors over distances of paths with known errors."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.compare.scoring.trajectory_error import relative_errors
from slamgauge.se2 import compose


def found(reference: Float, poses: Float) -> list[tuple[float | None, ...]]:
    errors = relative_errors(reference, poses)
    assert errors is not None
    return [astuple(each) for each in errors]


def line(length: float) -> Float:
    return np.column_stack([np.linspace(0.0, length, 21), np.zeros((21, 2))])


def test_the_error_of_a_wrong_scale_grows_with_the_distance_and_that_of_one_turn_does_not() -> None:
    """21 poses 1 m apart; lengths are 2 % too large. A length d has 21 - d segments."""
    assert found(line(20.0), line(20.4)) == [(d, pytest.approx(0.02 * d), 0.0, 21 - d) for d in (1.0, 2.0, 5.0, 10.0)]
    turned = line(20.0)
    turned[11:, 2] = 0.3  # one step has the error
    for distance, _, turn, pieces in found(line(20.0), turned):
        assert distance and pieces
        assert turn == pytest.approx(0.3 * np.sqrt(distance / pieces))


def test_relative_errors_do_not_change_with_a_rigid_motion() -> None:
    rng = np.random.default_rng(0)
    reference = np.cumsum(rng.normal(0.0, [0.5, 0.5, 0.1], (200, 3)), axis=0)
    poses = reference + rng.normal(0.0, 0.05, reference.shape)
    moved = compose([1e6, -2e6, 2.0], poses)
    for here, there in zip(found(reference, poses), found(reference, moved), strict=True):
        assert here == pytest.approx(there, rel=1e-6)


def test_segments_span_gaps_of_the_truth_and_a_robot_at_rest_has_none() -> None:
    gappy = line(20.0)
    gappy[5:8] = np.nan
    assert [pieces for *_, pieces in found(gappy, line(20.0))] == [17, 16, 13, 8]
    assert found(np.zeros((5, 3)), np.ones((5, 3))) == []
    assert relative_errors(None, np.zeros((5, 3))) is None
