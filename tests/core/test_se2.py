"""Laws of planar poses, by Hypothesis: the group, its exponential and logarithm, Jacobians by differences, kernels."""

from __future__ import annotations

import math
from functools import reduce

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from numpy.polynomial.legendre import leggauss

from slamgauge import formula_kernels, se2
from slamgauge.arrays import Float
from slamgauge.se2 import (
    between,
    chain,
    compose,
    exp,
    log,
    pose_rotation,
    right_jacobian,
    rotation,
    wrap,
)
from tests.reference.jacobians import assert_jacobian

PI = math.pi

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
    """Compare up to rounding for coordinates up to `scale`; heading differences are wrapped."""
    np.testing.assert_allclose(actual[..., :2], expected[..., :2], rtol=0, atol=1e-14 * (1 + scale))
    np.testing.assert_allclose(np.sin((actual[..., 2] - expected[..., 2]) / 2), 0, atol=1e-14)


@fixed_seed
@given(angles)
def test_a_wrapped_angle_lies_in_the_half_open_circle_whole_turns_away(angle: float) -> None:
    wrapped = float(wrap(angle))
    assert -PI < wrapped <= PI
    assert (angle - wrapped) / (2 * PI) == pytest.approx(round((angle - wrapped) / (2 * PI)), abs=1e-12)
    assert float(wrap(wrapped)) == wrapped == formula_kernels.wrap(angle)


@fixed_seed
@given(headings)
def test_an_angle_inside_the_interval_is_unchanged(angle: float) -> None:
    assert float(wrap(angle)) == angle


def test_odd_multiples_of_pi_and_the_numbers_next_to_them_are_wrapped() -> None:
    np.testing.assert_array_equal(wrap([-PI, PI, -3 * PI, 3 * PI]), [PI, PI, PI, PI])
    near = wrap([math.nextafter(-PI, 0.0), math.nextafter(-5 * PI, 0.0)])
    assert ((near > -PI) & (near <= PI)).all()


@fixed_seed
@given(poses, poses, poses)
def test_poses_are_a_group(a: Float, b: Float, c: Float) -> None:
    """Composition is associative, the origin is neutral, and `between` is the inverse of `compose`."""
    scale = float(np.abs([a[:2], b[:2], c[:2]]).max())
    assert_same_pose(compose(compose(a, b), c), compose(a, compose(b, c)), 8 * scale)
    assert_same_pose(compose(np.zeros(3), a), a, 0.0)
    assert_same_pose(compose(a, np.zeros(3)), a, 0.0)
    assert_same_pose(between(a, a), np.zeros(3), scale)
    assert_same_pose(between(a, compose(a, b)), b, 4 * scale)
    assert_same_pose(compose(a, between(a, b)), b, 4 * scale)


@fixed_seed
@given(poses, st.lists(poses, max_size=12))
def test_a_chain_is_repeated_composition(start: Float, increments: list[Float]) -> None:
    path = chain(start, np.reshape(increments, (-1, 3)))
    assert path.shape == (len(increments) + 1, 3)
    scale = float(np.abs([start[:2], *(u[:2] for u in increments)]).max())
    for k, pose in enumerate(path):
        # headings are summed before wrapping: k rounding errors of up to k pi, at distances of k scale
        assert_same_pose(pose, reduce(compose, increments[:k], start), 8 * (k + 1) ** 2 * scale)
    assert (np.abs(path[:, 2]) <= PI).all()


def test_increments_are_in_the_body_frame_at_their_start_and_rotations_turn_anticlockwise() -> None:
    np.testing.assert_allclose(compose([1.0, 2.0, PI / 2], [3.0, 0.5, 0.1]), [0.5, 5.0, PI / 2 + 0.1], rtol=1e-15)
    np.testing.assert_allclose(rotation(PI / 2) @ [1.0, 0.0], [0.0, 1.0], atol=1e-16)
    pose, increment = np.array([1.0, 2.0, 0.7]), np.array([0.3, -0.2, 0.1])
    np.testing.assert_allclose(pose + pose_rotation(pose[2]) @ increment, compose(pose, increment), atol=1e-15)


def test_functions_take_poses_of_any_shape() -> None:
    start = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, PI / 2]])
    np.testing.assert_allclose(compose(start, [1.0, 0.0, 0.0]), [[1, 0, 0], [1, 2, PI / 2]], atol=1e-15)
    rows = np.random.default_rng(0).normal(size=(2, 5, 3))
    for function in (exp, log, right_jacobian):
        np.testing.assert_array_equal(function(rows)[1, 2], function(rows[1, 2]))
    for function in (rotation, pose_rotation):
        np.testing.assert_array_equal(function(rows[..., 2])[1, 2], function(rows[1, 2, 2]))


# --- exponential, logarithm and Jacobians --------------------------------------------------------

SMALL = [0.0, 1e-300, 1e-12, -1e-7, 5e-5, -3e-4, 0.0099, 0.0101, 0.0999, 0.1001]  # around the limits of the series
TURNS = [*SMALL, 0.7, -2.0, 3.0, PI - 1e-6, -PI + 1e-6, PI - 1e-12]
PLACES = [[0.0, 0.0], [0.3, -0.1], [-40.0, 25.0]]
turns = st.one_of(headings, st.sampled_from(TURNS), st.floats(-0.2, 0.2))
tangents = st.tuples(lengths, lengths, turns).map(np.array)


@fixed_seed
@given(tangents)
def test_exponential_and_logarithm_are_inverse_and_the_inverse_has_the_opposite_tangent(tangent: Float) -> None:
    scale = 4 * float(np.abs(tangent[:2]).max())
    assert_same_pose(log(exp(tangent)), tangent, scale)
    assert_same_pose(exp(log(tangent)), tangent, scale)
    assert_same_pose(compose(exp(tangent), exp(-tangent)), np.zeros(3), scale)


@pytest.mark.parametrize("turn", [*TURNS, PI, 6.0])
def test_v_is_the_mean_of_rotations_up_to_the_turn(turn: float) -> None:
    nodes, weights = leggauss(40)
    mean = np.einsum("n,nij->ij", weights / 2, rotation((1 + nodes) / 2 * turn))
    c, s = se2.mean_cos_sin(turn)
    V = np.array([[c, -s], [s, c]])
    np.testing.assert_allclose(V, mean, rtol=0, atol=1e-14)
    J = rotation(PI / 2)
    np.testing.assert_allclose(V @ J * turn, rotation(turn) - np.eye(2), rtol=0, atol=1e-15)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("place", PLACES)
def test_both_jacobians_of_the_exponential(place: list[float], turn: float) -> None:
    """exp(t + d) = exp(t) exp(J_r(t) d) = exp(J_r(-t) d) exp(t) to first order in d."""
    tangent = np.array([*place, turn])
    at = exp(tangent)
    inverse = between(at, np.zeros(3))
    assert_jacobian(lambda t: log(between(at, exp(t))), right_jacobian(tangent), tangent, tolerance=1e-10, angles=[2])
    assert_jacobian(
        lambda t: log(compose(exp(t), inverse)), right_jacobian(-tangent), tangent, tolerance=1e-10, angles=[2]
    )


@fixed_seed
@given(tangents)
def test_the_adjoint_times_the_right_jacobian_is_the_left_jacobian(tangent: Float) -> None:
    x, y, heading = exp(tangent)
    adjoint = np.eye(3)
    adjoint[:2, :2], adjoint[:2, 2] = rotation(heading), [y, -x]
    scale = 1e-12 * (1 + float(np.abs(tangent[:2]).max()))
    np.testing.assert_allclose(adjoint @ right_jacobian(tangent), right_jacobian(-tangent), rtol=0, atol=scale)


# --- kernels -------------------------------------------------------------------------------------


@njit
def in_kernel(x: float, y: float, turn: float) -> tuple[float, ...]:
    return (
        *formula_kernels.mean_rotation(turn),
        *formula_kernels.exp(x, y, turn),
        *formula_kernels.log(x, y, turn),
        *formula_kernels.right_jacobian(x, y, turn),
        formula_kernels.wrap(turn),
    )


@pytest.mark.parametrize("turn", [*TURNS, PI])
@pytest.mark.parametrize("place", PLACES)
def test_kernels_compute_what_numpy_does(place: list[float], turn: float) -> None:
    x, y = place
    expected = (
        *se2.mean_cos_sin(turn),
        *se2.exp_xy(x, y, turn),
        *se2.log_xy(x, y, turn),
        *se2.right_jacobian_entries(x, y, turn),
        se2.wrap_angle(turn),
    )
    np.testing.assert_allclose(in_kernel(x, y, turn), expected, rtol=1e-15, atol=1e-15 * (1 + math.hypot(x, y)))
