"""Laws of planar poses, by Hypothesis."""

from __future__ import annotations

import math
from functools import reduce

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgauge.arrays import Float
from slamgauge.se2 import between, chain, compose, rotation, wrap

PI = math.pi
JUST_ABOVE_MINUS_PI = math.nextafter(-PI, 0.0)

half_turns = st.sampled_from([(2 * k + 1) * PI for k in range(-5, 6)])
near_half_turns = half_turns.flatmap(lambda a: st.sampled_from([a - 1e-9, a - 1e-14, a, a + 1e-14, a + 1e-9]))
angles = st.one_of(st.floats(-1e4, 1e4), near_half_turns)
headings = st.one_of(
    st.floats(-PI + 1e-15, PI),
    st.sampled_from([PI, math.nextafter(PI, 0.0), PI - 1e-12, -PI + 1e-12, -PI + 1e-9, 0.0, -0.0, 1e-300]),
)
lengths = st.floats(-1e3, 1e3)
poses = st.tuples(lengths, lengths, headings).map(np.array)
fixed_seed = settings(derandomize=True, deadline=None)


def assert_same_pose(actual: Float, expected: Float, scale: float) -> None:
    """Equal to rounding for coordinates up to `scale`; headings are compared around the circle."""
    np.testing.assert_allclose(actual[..., :2], expected[..., :2], rtol=0, atol=1e-14 * (1 + scale))
    np.testing.assert_allclose(np.sin((actual[..., 2] - expected[..., 2]) / 2), 0, atol=1e-14)


@fixed_seed
@given(angles)
def test_a_wrapped_angle_lies_in_the_half_open_circle(angle: float) -> None:
    assert -PI < wrap(angle) <= PI


@fixed_seed
@given(headings)
def test_an_angle_inside_the_circle_is_not_touched(angle: float) -> None:
    assert float(wrap(angle)) == angle


@pytest.mark.parametrize("angle", [JUST_ABOVE_MINUS_PI, math.nextafter(-5 * PI, 0.0)])
def test_the_number_next_to_an_odd_multiple_of_pi_is_wrapped_into_the_circle(angle: float) -> None:
    assert -PI < wrap(angle) <= PI


@fixed_seed
@given(angles)
def test_wrapping_changes_an_angle_by_whole_turns(angle: float) -> None:
    turns = (angle - float(wrap(angle))) / (2 * PI)
    assert turns == pytest.approx(round(turns), abs=1e-12)


def test_minus_pi_is_spelled_pi() -> None:
    np.testing.assert_array_equal(wrap([-PI, PI, -3 * PI, 3 * PI]), [PI, PI, PI, PI])


@fixed_seed
@given(poses, poses)
def test_between_undoes_compose(start: Float, increment: Float) -> None:
    scale = float(np.abs([start[:2], increment[:2]]).max())
    assert_same_pose(between(start, compose(start, increment)), increment, 4 * scale)


@fixed_seed
@given(poses, poses)
def test_compose_undoes_between(start: Float, end: Float) -> None:
    scale = float(np.abs([start[:2], end[:2]]).max())
    assert_same_pose(compose(start, between(start, end)), end, 4 * scale)


@fixed_seed
@given(poses, poses, poses)
def test_composition_is_associative(a: Float, b: Float, c: Float) -> None:
    scale = float(np.abs([a[:2], b[:2], c[:2]]).max())
    assert_same_pose(compose(compose(a, b), c), compose(a, compose(b, c)), 8 * scale)


@fixed_seed
@given(poses)
def test_the_origin_is_neutral(pose: Float) -> None:
    scale = float(np.abs(pose[:2]).max())
    assert_same_pose(compose(np.zeros(3), pose), pose, 0.0)
    assert_same_pose(compose(pose, np.zeros(3)), pose, 0.0)
    assert_same_pose(between(pose, pose), np.zeros(3), scale)


@fixed_seed
@given(poses, st.lists(poses, max_size=12))
def test_a_chain_is_repeated_composition(start: Float, increments: list[Float]) -> None:
    path = chain(start, np.reshape(increments, (-1, 3)))
    assert path.shape == (len(increments) + 1, 3)
    scale = float(np.abs([start[:2], *(u[:2] for u in increments)]).max())
    for k, pose in enumerate(path):
        # headings are summed before they are wrapped: k roundings of up to k pi, on levers of k scale
        assert_same_pose(pose, reduce(compose, increments[:k], start), 8 * (k + 1) ** 2 * scale)
    assert (np.abs(path[:, 2]) <= PI).all()


def test_the_increment_is_in_the_body_frame_at_its_start() -> None:
    np.testing.assert_allclose(compose([1.0, 2.0, PI / 2], [3.0, 0.5, 0.1]), [0.5, 5.0, PI / 2 + 0.1], rtol=1e-15)


def test_rotation_turns_anticlockwise() -> None:
    np.testing.assert_allclose(rotation(PI / 2) @ [1.0, 0.0], [0.0, 1.0], atol=1e-16)
    assert rotation(np.zeros((4, 5))).shape == (4, 5, 2, 2)


def test_poses_broadcast() -> None:
    start = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, PI / 2]])
    np.testing.assert_allclose(compose(start, [1.0, 0.0, 0.0]), [[1, 0, 0], [1, 2, PI / 2]], atol=1e-15)
