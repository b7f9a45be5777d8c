"""Every rule of the records' constructors, and the arrays that they store."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import FrozenInstanceError, fields
from typing import Any

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.errors import CovarianceError, UserError
from slamgauge.validation import as_covariances
from tests.reference.example_records import estimate, history, rays, recording, truth


def in_row(row: int, value: Any, array: Any) -> Float:
    """Return `array` with one row replaced."""
    changed = np.array(array, dtype=float)
    changed[row] = value
    return changed


def covs(count: int, row: int, matrix: Any) -> Float:
    """Return `count` unit covariances with one replaced."""
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
    (recording, {"odometry_cov": np.eye(2)}, "odometry_cov", "shape (2, 2, 2) does not fit; give shape (2, 3, 3)"),
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
    (truth, {"association": [4, -2, 9]}, "association[1]", "among landmark_ids"),
    (truth, {"association": [4, 4.5, 9]}, "association[1]", "whole number"),
    (estimate, {"landmark_ids": [9, 9]}, "landmark_ids[1]", "distinct"),
    (estimate, {"landmark_ids": [-9, 4]}, "landmark_ids[0]", ">= 0"),
    (estimate, {"landmark_ids": [9, 0.1]}, "landmark_ids[1]", "whole number"),
    (estimate, {"association": [4, 5, 9]}, "association[1]", "-1 for a rejected observation"),
    (estimate, {"association": [4, -2, 9]}, "association[1]", "-1 for a rejected observation"),
    (estimate, {"nis_dof": [0, 0.5, 2]}, "nis_dof[1]", "whole number"),
    # rays and history, alone and on the path
    (rays, {"birth": [0, -1]}, "rays.birth[1]", "give the step at which the ray began"),
    (rays, {"birth": [1, 1], "end": [0, -1]}, "rays.end[0]", "cannot end before its birth"),
    (rays, {"end": [2, -2]}, "rays.end[1]", "-1: open"),
    (rays, {"survivor": [3, -1]}, "rays.survivor[0]", "give the number of a member"),
    (rays, {"members": [3, -5, 2]}, "rays.members[1]", "cannot be negative"),
    (estimate, {"rays": rays(birth=[0, 3])}, "rays.birth[1] = 3", "must lie in 0..2"),
    (estimate, {"rays": rays(end=[3, -1])}, "rays.end[0] = 3", "must lie in 0..2"),
    (estimate, {"rays": rays(members=[3, 5])}, "rays.members", "give shape (3,)"),
    (estimate, {"history": history(step=[0, 3])}, "history.step[1] = 3", "must lie in 0..2"),
    (estimate, {"landmark_ids": []}, "landmark_ids", "give the id of each row"),
    # names
    (recording, {"sensor": "lidar"}, "sensor: 'lidar'", "use one of range-bearing, bearing, position"),
    (recording, {"sensor": None}, "sensor: None", "use one of"),
    (estimate, {"kind": "predicted"}, "kind: 'predicted'", "use 'filtered' or 'smoothed'"),
]


def label(rule: tuple[Callable[..., object], dict[str, Any], str, str]) -> str:
    make, _, start, words = rule
    return f"{make.__name__} {start} {words}"


@pytest.mark.parametrize(("make", "changes", "start", "words"), RULES, ids=map(label, RULES))
def test_a_broken_rule_is_one_line_that_names_field_row_and_remedy(
    make: Callable[..., object], changes: dict[str, Any], start: str, words: str
) -> None:
    with pytest.raises(ValueError) as caught:
        make(**changes)
    message = str(caught.value)
    assert type(caught.value) is (CovarianceError if "_cov" in start else UserError)
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
    """Different ids stay different, or are refused."""
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


def test_an_asymmetric_block_next_to_a_large_variance_is_refused() -> None:
    """Units differ within a covariance, so that each pair has its own tolerance."""
    with pytest.raises(ValueError, match="symmetric"):
        recording(prior_cov=[[1e6, 0.0, 0.0], [0.0, 1e-4, 9e-5], [0.0, 0.0, 1e-4]])


def test_an_entry_of_zero_variance_has_no_correlation() -> None:
    with pytest.raises(ValueError, match="eigenvalue"):
        recording(prior_cov=[[0.0, 0.1, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("make", [recording, truth, estimate, rays, history])
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


@pytest.mark.parametrize("make", [recording, truth, estimate, rays, history])
def test_fields_cannot_be_replaced_or_added(make: Callable[..., Any]) -> None:
    value = make()
    for field in fields(value):
        with pytest.raises(FrozenInstanceError):
            setattr(value, field.name, None)
    assert not hasattr(value, "__dict__")


@pytest.mark.parametrize("make", [recording, truth, estimate, rays, history])
def test_values_are_equal_field_by_field_and_not_hashable(make: Callable[..., Any]) -> None:
    one, other = make(), make()
    assert one == other
    assert (one != other) is False
    assert one != 3
    with pytest.raises(TypeError, match="unhashable"):
        hash(one)


def test_equal_values_have_their_gaps_at_the_same_places() -> None:
    gap = truth(poses=[[0, 0, 0], [math.nan] * 3, [0, 0, 0]])
    assert gap == truth(poses=[[0, 0, 0], [math.nan] * 3, [0, 0, 0]])
    assert gap != truth(poses=[[0, 0, 0], [0, 0, 0], [math.nan] * 3])
    assert gap != truth(poses=None)
    assert rays() == rays()
    assert rays() != rays(distances=[[1.0, 2.0, math.nan], [1.0, 2.0, math.nan]])


def test_an_estimate_is_equal_down_to_its_rays_and_history() -> None:
    assert estimate(rays=rays(), history=history()) == estimate(rays=rays(), history=history())
    assert estimate(rays=rays()) != estimate(rays=rays(members=[3, 5, 3]))
    assert estimate(rays=rays()) != estimate()
    assert recording() != recording(sensor="position")
    assert recording() != recording(landmark=None)


def test_errors_of_a_long_recording_name_the_row():
    many = np.tile(np.eye(2), (150_000, 1, 1))
    np.testing.assert_array_equal(as_covariances("cov", many, (None, 2, 2), definite=True), many)
    many[140_000] = [[1.0, 2.0], [2.0, 1.0]]
    with pytest.raises(UserError, match=r"^cov\[140000\] = .*: a covariance must not have a negative eigenvalue$"):
        as_covariances("cov", many, (None, 2, 2))


def test_covariances_at_the_limits_of_doubles_cause_no_warning():
    with np.errstate(all="raise", under="ignore"):
        whole = as_covariances("cov", 1.5e308 * np.eye(3)[None], (None, 3, 3))
        np.testing.assert_array_equal(whole, 1.5e308 * np.eye(3)[None])
        with pytest.raises(UserError, match=r"^cov\[0\] = .*: a covariance must not have a negative eigenvalue$"):
            as_covariances("cov", [[[1e-300, 1e308], [1e308, 1e-300]]], (None, 2, 2))
