"""Alignment as a least-squares rigid motion, and relative errors over distances of paths with known errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgauge.arrays import Float
from slamgauge.compare.scoring.nan_stats import rms
from slamgauge.compare.scoring.trajectory_error import aligned_errors, relative_errors
from slamgauge.estimate import Estimate
from slamgauge.se2 import compose, rotation
from slamgauge.truth import Truth

from .builders import straight

angles = st.floats(-math.pi, math.pi)
lengths = st.floats(-100, 100)


@given(lengths, lengths, angles, st.integers(0, 2**32 - 1), st.integers(1, 8))
def test_the_aligned_error_does_not_change_with_a_rigid_motion(
    x: float, y: float, turn: float, seed: int, n: int
) -> None:
    rng = np.random.default_rng(seed)
    reference = rng.normal(size=(n, 2))
    positions = reference + 0.3 * rng.normal(size=(n, 2))
    before = rms(np.linalg.norm(aligned_errors(positions, reference), axis=1))
    moved = compose([x, y, turn], np.column_stack([positions, np.zeros(n)]))[:, :2]
    after = rms(np.linalg.norm(aligned_errors(moved, reference), axis=1))
    assert after == pytest.approx(before, abs=1e-9)


@given(st.integers(0, 2**32 - 1), angles, lengths, lengths)
def test_no_rigid_motion_aligns_better(seed: int, turn: float, x: float, y: float) -> None:
    rng = np.random.default_rng(seed)
    reference, positions = rng.normal(size=(2, 6, 2))
    aligned = reference + aligned_errors(positions, reference)
    center = reference.mean(axis=0)
    other = (aligned - center) @ rotation(turn).T + center + [x, y]
    assert np.sum((aligned - reference) ** 2) <= np.sum((other - reference) ** 2) + 1e-9


def test_alignment_does_not_reflect_scale_or_modify_its_input() -> None:
    reference = np.array([[0.0, 0], [2, 0], [2, 1]])
    positions = 3 * reference * [1, -1]
    given_positions, given_reference = positions.copy(), reference.copy()
    aligned = reference + aligned_errors(positions, reference)
    assert np.array_equal(positions, given_positions)
    assert np.array_equal(reference, given_reference)
    steps, aligned_steps = np.diff(positions, axis=0), np.diff(aligned, axis=0)
    assert np.linalg.norm(aligned_steps, axis=1) == pytest.approx(np.linalg.norm(steps, axis=1))
    assert np.linalg.det(aligned_steps) == pytest.approx(np.linalg.det(steps))


@pytest.mark.parametrize("length", [0.0, 1.0])
def test_alignment_of_degenerate_paths(length: float) -> None:
    reference = np.column_stack([np.linspace(0, length, 5), np.zeros(5)])  # a point, a line
    reference[2] = np.nan
    left = aligned_errors(np.tile([3.0, -4.0], (5, 1)), reference)
    assert np.isnan(left[2]).all()
    assert np.nanmean(left, axis=0) == pytest.approx([0.0, 0.0])


# --- by distance ---------------------------------------------------------------------------------


def found(reference: Float, poses: Float) -> list[tuple[float | None, ...]]:
    errors = relative_errors(Truth(poses=reference), straight(len(poses) - 1), Estimate("filtered", poses))
    assert errors is not None
    return [tuple(each.values()) for each in errors]


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
    assert relative_errors(Truth(), straight(4), Estimate("filtered", np.zeros((5, 3)))) is None
