"""The vocabulary: laws of planar poses by Hypothesis, and every rule that the constructors check."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import FrozenInstanceError, fields
from functools import reduce
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgauge.arrays import Float
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import between, chain, compose, rotation, wrap
from slamgauge.truth import Truth

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


# --- SE(2) -------------------------------------------------------------------------------------


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


# --- examples that the rules below break one at a time -------------------------------------------


def recording(**changes: Any) -> Recording:
    """Three poses and three observations, valid but for `changes`."""
    values: dict[str, Any] = {
        "stamps": [0.0, 0.1, 0.2],
        "prior_mean": [0.0, 0.0, 0.0],
        "prior_cov": np.diag([0.01, 0.01, 1e-4]),
        "odometry": [[0.1, 0.0, 0.01], [0.1, 0.0, 0.01]],
        "odometry_cov": np.tile(np.diag([1e-3, 0.0, 1e-5]), (2, 1, 1)),
        "sensor": "range-bearing",
        "observation_step": [0, 1, 1],
        "observation": [[2.0, 0.1], [3.0, -0.2], [1.0, 3.1]],
        "observation_cov": np.tile(np.diag([0.01, 0.007]), (3, 1, 1)),
        "landmark": [4, 4, 9],
    }
    return Recording(**(values | changes))


def truth(**changes: Any) -> Truth:
    values: dict[str, Any] = {
        "poses": np.zeros((3, 3)),
        "landmark_ids": [4, 9],
        "landmarks": [[1.0, 2.0], [3.0, 4.0]],
        "association": [4, 4, 9],
    }
    return Truth(**(values | changes))


def estimate(**changes: Any) -> Estimate:
    values: dict[str, Any] = {
        "kind": "filtered",
        "poses": np.zeros((3, 3)),
        "pose_covs": np.tile(np.eye(3), (3, 1, 1)),
        "landmark_ids": [9, 4],
        "landmarks": [[1.0, 2.0], [3.0, 4.0]],
        "landmark_covs": np.tile(np.eye(2), (2, 1, 1)),
        "association": [4, -1, 9],
        "nis": [0.0, 1.5, 2.0],
        "nis_dof": [0, 2, 2],
        "seconds": [0.0, 1e-4, 1e-4],
    }
    return Estimate(**(values | changes))


def in_row(row: int, value: Any, array: Any) -> Float:
    """`array` with one row replaced."""
    changed = np.array(array, dtype=float)
    changed[row] = value
    return changed


def covs(count: int, row: int, matrix: Any) -> Float:
    """`count` unit covariances of which one is replaced."""
    return in_row(row, matrix, np.tile(np.eye(len(matrix)), (count, 1, 1)))


ASYMMETRIC = [[1.0, 0.2, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]]
INDEFINITE = [[1.0, 1.1, 0.0], [1.1, 1.0, 0.0], [0.0, 0.0, 1.0]]
NEGATIVE = np.diag([1.0, 1.0, -0.1])
MIXED_UNITS_NEGATIVE = np.diag([1e6, 1e6, -1e-4])
MIXED_UNITS_INDEFINITE = [[1e6, 0.0, 0.0], [0.0, 1e-8, 2e-8], [0.0, 2e-8, 1e-8]]

# (constructor, changes, field and row that the message must begin with, words of the rule or remedy)
RULES: list[tuple[Callable[..., object], dict[str, Any], str, str]] = [
    # numbers
    (recording, {"stamps": [0.0, math.nan, 0.2]}, "stamps[1]", "finite"),
    (recording, {"stamps": [0.0, 0.1, math.inf]}, "stamps[2]", "finite"),
    (recording, {"prior_mean": [0.0, math.inf, 0.0]}, "prior_mean[1]", "finite"),
    (recording, {"prior_cov": np.diag([1.0, 1.0, math.nan])}, "prior_cov[2]", "finite"),
    (recording, {"odometry": [[0.1, 0.0, 0.0], [0.1, math.nan, 0.0]]}, "odometry[1]", "finite"),
    (recording, {"odometry_cov": covs(2, 1, np.diag([1.0, math.inf, 1.0]))}, "odometry_cov[1]", "finite"),
    (recording, {"observation": [[2, 0], [3, 0], [math.nan, 3]]}, "observation[2]", "finite"),
    (recording, {"observation_cov": covs(3, 2, np.diag([math.nan, 1.0]))}, "observation_cov[2]", "finite"),
    (recording, {"observation_step": [0, math.nan, 1]}, "observation_step[1]", "finite"),
    (recording, {"landmark": [4, math.inf, 9]}, "landmark[1]", "finite"),
    (truth, {"poses": [[0, 0, 0], [0, math.nan, 0], [0, 0, 0]]}, "poses[1]", "NaN in the whole row"),
    (truth, {"poses": [[0, 0, 0], [0, 0, 0], [math.inf] * 3]}, "poses[2]", "finite"),
    (truth, {"landmarks": [[1.0, 2.0], [math.nan, 4.0]]}, "landmarks[1]", "finite"),
    (truth, {"association": [4, math.nan, 9]}, "association[1]", "finite"),
    (estimate, {"poses": in_row(2, math.nan, np.zeros((3, 3)))}, "poses[2]", "finite"),
    (estimate, {"pose_covs": covs(3, 1, np.full((3, 3), math.nan))}, "pose_covs[1]", "finite"),
    (estimate, {"landmarks": [[1.0, 2.0], [-math.inf, 4.0]]}, "landmarks[1]", "finite"),
    (estimate, {"landmark_covs": covs(2, 0, np.diag([math.inf, 1.0]))}, "landmark_covs[0]", "finite"),
    (estimate, {"nis": [0.0, math.nan, 2.0]}, "nis[1]", "finite"),
    (estimate, {"nis_dof": [0, math.nan, 2]}, "nis_dof[1]", "finite"),
    (estimate, {"seconds": [0.0, math.inf, 0.0]}, "seconds[1]", "finite"),
    # not numbers at all
    (recording, {"odometry": "far"}, "odometry", "not an array of numbers; give shape (any, 3)"),
    (recording, {"observation": [[1.0, 0.0], [1.0]]}, "observation", "not an array of numbers; give shape (any, 2)"),
    (recording, {"odometry": None}, "odometry", "give shape (any, 3)"),
    (estimate, {"poses": object()}, "poses", "not an array of numbers; give shape (any, 3)"),
    # shapes
    (recording, {"stamps": [0.0, 0.1]}, "stamps", "shape (2,) does not fit; give shape (3,)"),
    (recording, {"prior_mean": [0.0, 0.0]}, "prior_mean", "shape (2,) does not fit; give shape (3,)"),
    (recording, {"prior_cov": np.eye(2)}, "prior_cov", "shape (2, 2) does not fit; give shape (3, 3)"),
    (recording, {"odometry": np.zeros((2, 2))}, "odometry", "shape (2, 2) does not fit; give shape (any, 3)"),
    (recording, {"odometry": np.zeros(3)}, "odometry", "shape (3,) does not fit; give shape (any, 3)"),
    (recording, {"odometry_cov": np.eye(3)}, "odometry_cov", "shape (3, 3) does not fit; give shape (2, 3, 3)"),
    (recording, {"observation": np.ones((3, 1))}, "observation", "shape (3, 1) does not fit; give shape (any, 2)"),
    (recording, {"sensor": "bearing"}, "observation", "shape (3, 2) does not fit; give shape (any, 1)"),
    (recording, {"observation_cov": np.ones((3, 1, 1))}, "observation_cov", "give shape (3, 2, 2)"),
    (recording, {"observation_step": [0, 1]}, "observation_step", "give shape (3,)"),
    (recording, {"landmark": [4, 9]}, "landmark", "give shape (3,)"),
    (truth, {"poses": np.zeros((3, 2))}, "poses", "give shape (any, 3)"),
    (truth, {"landmarks": np.zeros((3, 2))}, "landmarks", "give shape (2, 2)"),
    (truth, {"landmark_ids": None}, "landmarks", "give landmark_ids and landmarks together"),
    (truth, {"landmarks": None}, "landmarks", "give landmark_ids and landmarks together"),
    (truth, {"association": [[4, 9]]}, "association", "give shape (any,)"),
    (estimate, {"poses": np.zeros((3, 2))}, "poses", "give shape (any, 3)"),
    (estimate, {"pose_covs": np.zeros((2, 3, 3))}, "pose_covs", "give shape (3, 3, 3)"),
    (estimate, {"landmarks": np.zeros((1, 2))}, "landmarks", "give shape (2, 2)"),
    (estimate, {"landmarks": None}, "landmarks", "give shape (2, 2)"),
    (estimate, {"landmark_ids": None}, "landmark_ids", "give shape (any,)"),
    (estimate, {"landmark_covs": np.zeros((3, 2, 2))}, "landmark_covs", "give shape (2, 2, 2)"),
    (estimate, {"association": 4}, "association", "give shape (any,)"),
    (estimate, {"nis": [0.0, 1.0]}, "nis", "give shape (3,)"),
    (estimate, {"nis_dof": [0, 2]}, "nis_dof", "give shape (3,)"),
    (estimate, {"nis_dof": None}, "nis", "give nis and nis_dof together"),
    (estimate, {"nis": None}, "nis", "give nis and nis_dof together"),
    (estimate, {"seconds": [0.0]}, "seconds", "give shape (3,)"),
    # covariances
    (recording, {"prior_cov": ASYMMETRIC}, "prior_cov", "symmetric; use (P + P.T) / 2"),
    (recording, {"prior_cov": INDEFINITE}, "prior_cov", "negative eigenvalue"),
    (recording, {"prior_cov": NEGATIVE}, "prior_cov", "negative variance"),
    (recording, {"prior_cov": MIXED_UNITS_NEGATIVE}, "prior_cov", "negative variance"),
    (recording, {"prior_cov": MIXED_UNITS_INDEFINITE}, "prior_cov", "negative eigenvalue"),
    (recording, {"odometry_cov": covs(2, 1, ASYMMETRIC)}, "odometry_cov[1]", "symmetric"),
    (recording, {"odometry_cov": covs(2, 1, INDEFINITE)}, "odometry_cov[1]", "negative eigenvalue"),
    (recording, {"odometry_cov": covs(2, 1, MIXED_UNITS_NEGATIVE)}, "odometry_cov[1]", "negative variance"),
    (recording, {"observation_cov": covs(3, 2, [[1.0, 0.5], [0.4, 1.0]])}, "observation_cov[2]", "symmetric"),
    (recording, {"observation_cov": covs(3, 2, [[1.0, 2.0], [2.0, 1.0]])}, "observation_cov[2]", "negative eigen"),
    (recording, {"observation_cov": covs(3, 2, np.diag([-1.0, 1.0]))}, "observation_cov[2]", "negative variance"),
    (recording, {"observation_cov": covs(3, 1, np.diag([0.0, 1.0]))}, "observation_cov[1]", "positive definite here"),
    (recording, {"observation_cov": covs(3, 1, np.ones((2, 2)))}, "observation_cov[1]", "positive definite here"),
    (estimate, {"pose_covs": covs(3, 2, ASYMMETRIC)}, "pose_covs[2]", "symmetric"),
    (estimate, {"pose_covs": covs(3, 2, INDEFINITE)}, "pose_covs[2]", "negative eigenvalue"),
    (estimate, {"pose_covs": covs(3, 2, NEGATIVE)}, "pose_covs[2]", "negative variance"),
    (estimate, {"landmark_covs": covs(2, 1, [[1.0, 2.0], [2.0, 1.0]])}, "landmark_covs[1]", "negative eigenvalue"),
    # order and range
    (recording, {"stamps": [0.0, 0.1, 0.1]}, "stamps[2]", "increase strictly; sort the steps"),
    (recording, {"stamps": [0.0, -0.1, 0.2]}, "stamps[1]", "increase strictly"),
    (recording, {"observation_step": [0, 1, 3]}, "observation_step[2]", "must lie in 0..2"),
    (recording, {"observation_step": [-1, 1, 1]}, "observation_step[0]", "must lie in 0..2"),
    (recording, {"observation_step": [1, 0, 2]}, "observation_step[1]", "must not decrease; sort"),
    (recording, {"observation_step": [0, 0.5, 1]}, "observation_step[1]", "whole number"),
    (recording, {"observation": [[2, 0], [-1e-9, 0], [1, 3]]}, "observation[1]", "a range cannot be negative"),
    # ids
    (recording, {"landmark": [4, -1, 9]}, "landmark[1]", "id must be >= 0; use landmark=None"),
    (recording, {"landmark": [4, 4, 9.5]}, "landmark[2]", "whole number"),
    (truth, {"landmark_ids": [4, 4]}, "landmark_ids[1]", "distinct"),
    (truth, {"landmark_ids": [4, -9]}, "landmark_ids[1]", ">= 0"),
    (truth, {"landmark_ids": [4.5, 9]}, "landmark_ids[0]", "whole number"),
    (truth, {"association": [4, 5, 9]}, "association[1]", "among landmark_ids"),
    (truth, {"association": [4, -1, 9]}, "association[1]", "among landmark_ids"),
    (truth, {"association": [4, 4.5, 9]}, "association[1]", "whole number"),
    (estimate, {"landmark_ids": [9, 9]}, "landmark_ids[1]", "distinct"),
    (estimate, {"landmark_ids": [-9, 4]}, "landmark_ids[0]", ">= 0"),
    (estimate, {"landmark_ids": [9, 0.1]}, "landmark_ids[1]", "whole number"),
    (estimate, {"association": [4, 5, 9]}, "association[1]", "-1 for a rejected observation"),
    (estimate, {"association": [4, -2, 9]}, "association[1]", "-1 for a rejected observation"),
    (estimate, {"nis_dof": [0, 0.5, 2]}, "nis_dof[1]", "whole number"),
    # names
    (recording, {"sensor": "lidar"}, "sensor: 'lidar'", "use one of range-bearing, bearing, position"),
    (recording, {"sensor": None}, "sensor: None", "use one of"),
    (estimate, {"kind": "predicted"}, "kind: 'predicted'", "use 'filtered' or 'smoothed'"),
]


def label(rule: tuple[Callable[..., object], dict[str, Any], str, str]) -> str:
    make, _, start, words = rule
    return f"{make.__name__} {start} {words}"


# --- validation ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("make", "changes", "start", "words"), RULES, ids=map(label, RULES))
def test_a_broken_rule_is_one_line_that_names_field_row_and_remedy(
    make: Callable[..., object], changes: dict[str, Any], start: str, words: str
) -> None:
    with pytest.raises(ValueError) as caught:
        make(**changes)
    message = str(caught.value)
    assert type(caught.value) is UserError
    assert "\n" not in message
    assert message.startswith(start)
    assert words in message


def test_the_first_bad_row_is_named_with_its_value() -> None:
    with pytest.raises(ValueError, match=r"^odometry\[1\] = \[0\.1, nan, 0\. \]: "):
        recording(odometry=[[0.1, 0.0, 0.0], [0.1, math.nan, 0.0]])


def test_the_examples_themselves_are_valid() -> None:
    assert (recording().steps, recording().odometry.shape) == (2, (2, 3))
    assert truth().association is not None
    assert estimate().nis_dof is not None


def test_ids_too_large_for_whole_float64_numbers_are_not_merged_silently() -> None:
    """Two ids that differ must stay different, or be refused."""
    try:
        landmark = recording(landmark=[2**53, 2**53 + 1, 2**53 + 2]).landmark
    except ValueError:
        return
    assert landmark is not None
    assert len(np.unique(landmark)) == 3


@pytest.mark.parametrize(
    "matrix",
    [
        pytest.param(np.zeros((3, 3)), id="fixed"),
        pytest.param(np.diag([1e6, 1e6, 1e-10]), id="mixed units"),
        pytest.param(np.diag([1e-30, 1e-30, 1e-34]), id="tiny"),
        pytest.param(np.diag([0.01, 0.0, 1e-4]), id="no slip"),
        pytest.param(np.outer([1e3, -1e3, 1e-4], [1e3, -1e3, 1e-4]), id="rank one, mixed units"),
        pytest.param(np.array([[1.0, 1 - 1e-7, 0], [1 - 1e-7, 1.0, 0], [0, 0, 1e-12]]), id="nearly singular"),
    ],
)
def test_extreme_but_legal_covariances_are_accepted_unchanged(matrix: Float) -> None:
    accepted = recording(prior_cov=matrix, odometry_cov=np.tile(matrix, (2, 1, 1)))
    np.testing.assert_array_equal(accepted.prior_cov, matrix)
    np.testing.assert_array_equal(accepted.odometry_cov[1], matrix)
    np.testing.assert_array_equal(estimate(pose_covs=np.tile(matrix, (3, 1, 1))).pose_covs, np.tile(matrix, (3, 1, 1)))


def test_rounding_of_a_symmetric_matrix_is_removed() -> None:
    skewed = np.array([[2.0, 1.0, 0.0], [1.0 + 1e-15, 2.0, 0.0], [0.0, 0.0, 1.0]])
    assert not np.array_equal(skewed, skewed.T)
    accepted = recording(prior_cov=skewed).prior_cov
    assert np.array_equal(accepted, accepted.T)


def test_an_asymmetric_block_beside_a_large_variance_is_refused() -> None:
    """Units differ within a covariance, so symmetry has to be judged against each pair's own sigmas."""
    with pytest.raises(ValueError, match="symmetric"):
        recording(prior_cov=[[1e6, 0.0, 0.0], [0.0, 1e-4, 9e-5], [0.0, 0.0, 1e-4]])


def test_a_covariance_with_a_variance_of_zero_has_no_correlation() -> None:
    with pytest.raises(ValueError, match="eigenvalue"):
        recording(prior_cov=[[0.0, 0.1, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]])


# --- what is legal -------------------------------------------------------------------------------


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


def test_the_first_steps_are_a_recording_of_their_own() -> None:
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


def test_observations_can_be_left_out() -> None:
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


def test_a_truth_may_lack_anything() -> None:
    nothing = Truth()
    assert [getattr(nothing, field.name) for field in fields(Truth)] == [None] * 4
    assert truth(landmark_ids=None, landmarks=None, association=[7, 7]).association is not None
    no_landmarks = truth(landmark_ids=[], landmarks=np.zeros((0, 2)), association=[]).landmarks
    assert no_landmarks is not None
    assert no_landmarks.shape == (0, 2)


def test_a_truth_may_have_gaps() -> None:
    with_gap = truth(poses=[[0, 0, 4.0], [math.nan] * 3, [1, 1, -4.0]]).poses
    assert with_gap is not None
    assert np.isnan(with_gap[1]).all()
    np.testing.assert_allclose(with_gap[[0, 2], 2], [4.0 - 2 * PI, 2 * PI - 4.0])


def test_an_estimate_needs_only_kind_and_poses() -> None:
    least = Estimate(kind="smoothed", poses=np.zeros((3, 3)))
    assert least.landmark_ids is not None
    assert least.landmarks is not None
    assert (least.landmark_ids.shape, least.landmarks.shape) == ((0,), (0, 2))
    assert least.pose_covs is None
    assert least.association is None


def test_headings_of_an_estimate_are_wrapped() -> None:
    np.testing.assert_allclose(estimate(poses=[[0, 0, 7.0], [0, 0, -PI], [0, 0, PI]]).poses[:, 2], [7 - 2 * PI, PI, PI])


# --- arrays are the value's own ------------------------------------------------------------------


@pytest.mark.parametrize("make", [recording, truth, estimate])
def test_arrays_are_copied_and_read_only(make: Callable[..., Any]) -> None:
    plain = make()
    names = [field.name for field in fields(plain) if isinstance(getattr(plain, field.name), np.ndarray)]
    given_arrays = {name: np.array(getattr(plain, name)) for name in names}
    value = make(**given_arrays)
    assert len(names) >= 4
    for name, array in given_arrays.items():
        own = getattr(value, name)
        kept = own.copy()
        assert not np.shares_memory(own, array)
        array += 1
        np.testing.assert_array_equal(own, kept)
        with pytest.raises(ValueError, match="read-only"):
            own[...] = 0
        assert own.dtype in (np.float64, np.int64)


@pytest.mark.parametrize("make", [recording, truth, estimate])
def test_fields_cannot_be_replaced_or_added(make: Callable[..., Any]) -> None:
    value = make()
    for field in fields(value):
        with pytest.raises(FrozenInstanceError):
            setattr(value, field.name, None)
    assert not hasattr(value, "__dict__")
