"""Odometry split at observations: the parts compose to the whole."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge.arrays import Float
from slamgauge.compare.datasets.imported_log import Odometry, split_at
from slamgauge.se2 import chain, wrap

angles = st.floats(-3.1, 3.1) | st.floats(-1e-9, 1e-9)
lengths = st.floats(-10.0, 10.0)
START = np.array([1.0, -2.0, 3.0])


def one_step(increment: Float) -> Odometry:
    return Odometry(np.array([5.0, 7.0]), increment[None], np.diag([0.4, 0.0, 0.2])[None])


@given(lengths, lengths, angles, st.lists(st.floats(0.001, 1.999), max_size=5))
def test_parts_of_a_step_make_up_the_whole(dx: float, dy: float, turn: float, moments: list[float]):
    whole = one_step(np.array([dx, dy, turn]))
    parts, steps = split_at(whole, 5.0 + np.array(moments))
    end = chain(START, parts.increments)[-1]
    expected = chain(START, whole.increments)[-1]
    assert_allclose(end[:2], expected[:2], atol=1e-12)
    assert abs(wrap(end[2] - expected[2])) < 1e-12
    assert_allclose(parts.covs.sum(axis=0), whole.covs[0], atol=1e-12)
    assert_allclose(parts.stamps[steps], 5.0 + np.array(moments), atol=1e-6)


def test_parts_lie_on_the_arc():
    quarter = one_step(np.array([1.0, 1.0, np.pi / 2]))  # a quarter of the circle around (0, 1)
    parts, steps = split_at(quarter, np.array([5.5, 5.5, 6.0, 6.0 + 1e-8]))
    assert_array_equal(steps, [1, 1, 2, 2])
    path = chain(np.zeros(3), parts.increments)
    angle = np.pi / 2 * np.array([0, 0.25, 0.5, 1.0])
    assert_allclose(path, np.column_stack([np.sin(angle), 1 - np.cos(angle), angle]), atol=1e-15)
    assert_allclose(parts.covs[:, 0, 0], [0.1, 0.1, 0.2])


def test_stamps_that_coincide_split_nothing():
    """Also a little before the first stamp and after the last one."""
    odometry = Odometry(np.array([0.0, 0.1, 0.2]), np.full((2, 3), 0.3), np.tile(np.eye(3), (2, 1, 1)))
    same, steps = split_at(odometry, np.array([0.2 + 1e-7, -1e-7, 0.1 + 1e-7]))
    assert_array_equal(steps, [2, 0, 1])
    for before, after in zip(odometry, same, strict=True):
        assert_array_equal(before, after)
