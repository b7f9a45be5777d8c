import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgauge.compare.scoring.nan_stats import rms
from slamgauge.compare.scoring.trajectory_error import aligned_errors
from slamgauge.se2 import compose, rotation

angles = st.floats(-math.pi, math.pi)
lengths = st.floats(-100, 100)


@given(lengths, lengths, angles, st.integers(0, 2**32 - 1), st.integers(1, 8))
def test_aligned_error_does_not_change_with_a_rigid_motion(x: float, y: float, turn: float, seed: int, n: int) -> None:
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


def test_alignment_neither_reflects_nor_scales_nor_modifies() -> None:
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
