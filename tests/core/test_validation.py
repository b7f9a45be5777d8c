"""Every rule of the records' constructors, and the arrays that they store."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import FrozenInstanceError, fields
from typing import Any

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.covariances import without_negative_eigenvalues
from slamgauge.errors import CovarianceError, UserError
from slamgauge.validation import as_covariances
from tests.reference.example_records import estimate, history, rays, recording, truth

RECORDS = (recording, truth, estimate, rays, history)
EVERY = pytest.mark.parametrize("make", RECORDS)


def arrays_of(make: Callable[..., Any]) -> Iterator[tuple[str, str, Any]]:
    """Yield the name, the label in errors and a copy of each array of a record."""
    record, prefix = make(), f"{make.__name__}." if make in (rays, history) else ""
    for field in fields(record):
        value = getattr(record, field.name)
        if isinstance(value, np.ndarray):
            yield field.name, prefix + field.name, value.copy()


def assert_refused(make: Callable[..., Any], changes: dict[str, Any], start: str, words: str) -> None:
    with pytest.raises(ValueError) as caught:
        make(**changes)
    message = str(caught.value)
    assert type(caught.value) is (CovarianceError if "_cov" in start or ".cov" in start else UserError)
    assert "\n" not in message
    assert message.startswith(start), message
    assert words in message, message


@EVERY
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_numbers_must_be_finite(make: Callable[..., Any], value: float) -> None:
    for name, label, array in arrays_of(make):
        wrong = array.astype(float)
        wrong[-1, ...].flat[0] = value
        if name != "distances":  # NaN for a ray with fewer members
            assert_refused(make, {name: wrong}, f"{label}[{len(array) - 1}]", "finite")


ANY_LENGTH = (truth, "poses"), (truth, "association"), (estimate, "association"), (rays, "members")


@EVERY
def test_arrays_have_their_shape(make: Callable[..., Any]) -> None:
    for name, label, array in arrays_of(make):
        assert_refused(make, {name: array[None]}, f"{label}: shape", "does not fit; give shape (")
        assert_refused(make, {name: "far"}, f"{label}: not an array of numbers", "; give shape (")
        if (make, name) not in ANY_LENGTH:
            with pytest.raises(UserError, match=r"^[\w.]+: shape \(.*\) does not fit; give shape \("):
                make(**{name: array[:-1]})


@EVERY
def test_steps_and_ids_are_whole_numbers(make: Callable[..., Any]) -> None:
    for name, label, array in arrays_of(make):
        if array.dtype == np.int64:
            wrong = array.astype(float)
            wrong[-1] += 0.5
            assert_refused(make, {name: wrong}, f"{label}[{len(array) - 1}]", "whole number")


BLOCKS: list[tuple[Any, str]] = [  # the first entries of a covariance
    ([[1.0, 0.2], [0.1, 1.0]], "symmetric; use (P + P.T) / 2"),
    ([[1.0, 1.1], [1.1, 1.0]], "negative eigenvalue"),
    ([[-0.1, 0.0], [0.0, 1.0]], "negative variance"),
    ([[-1e-4, 0.0], [0.0, 1e6]], "negative variance"),  # in mixed units
    ([[1e-8, 2e-8], [2e-8, 1e-8]], "negative eigenvalue"),
    ([[1e-4, 9e-5], [0.0, 1e-4]], "symmetric"),  # each pair has its own tolerance
]


@EVERY
def test_covariances_are_symmetric_and_semidefinite(make: Callable[..., Any]) -> None:
    for name, label, array in arrays_of(make):
        if not name.endswith("cov") and not name.endswith("covs"):
            continue
        for block, words in BLOCKS:
            wrong, whole = array.copy(), np.diag([1e6] * array.shape[-1])
            whole[:2, :2] = block
            wrong[-1 if array.ndim == 3 else ...] = whole
            assert_refused(make, {name: wrong}, f"{label}[1]" if array.ndim == 3 and len(array) == 2 else label, words)


# (constructor, changes, field and row that the message must begin with, words of the rule or remedy)
RULES: list[tuple[Callable[..., object], dict[str, Any], str, str]] = [
    (recording, {"observation": [[1.0, 0.0], [1.0]]}, "observation", "not an array of numbers; give shape (any, 2)"),
    (recording, {"odometry": None}, "odometry", "give shape (any, 3)"),
    (recording, {"odometry_cov": np.eye(2)}, "odometry_cov", "shape (2, 2, 2) does not fit; give shape (2, 3, 3)"),
    (recording, {"sensor": "bearing"}, "observation", "shape (3, 2) does not fit; give shape (any, 1)"),
    (recording, {"observation_cov": np.diag([0.0, 1.0])}, "observation_cov[0]", "positive definite here"),
    (recording, {"observation_cov": np.ones((2, 2))}, "observation_cov[0]", "positive definite here"),
    (recording, {"prior_cov": [[0.0, 0.1, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]]}, "prior_cov", "negative eigenv"),
    (truth, {"landmark_ids": None}, "landmarks", "give landmark_ids and landmarks together"),
    (truth, {"landmarks": None}, "landmarks", "give landmark_ids and landmarks together"),
    (estimate, {"landmark_ids": []}, "landmark_ids", "give the id of each row"),
    (estimate, {"nis_dof": None}, "nis", "give nis and nis_dof together"),
    (estimate, {"nis": None}, "nis", "give nis and nis_dof together"),
    # order and range
    (recording, {"stamps": [0.0, 0.1, 0.1]}, "stamps[2]", "increase strictly; sort the steps"),
    (recording, {"observation_step": [0, 1, 3]}, "observation_step[2]", "must lie in 0..2"),
    (recording, {"observation_step": [-1, 1, 1]}, "observation_step[0]", "must lie in 0..2"),
    (recording, {"observation_step": [1, 0, 2]}, "observation_step[1]", "must not decrease; sort"),
    (recording, {"observation": [[2, 0], [-1e-9, 0], [1, 3]]}, "observation[1]", "a range cannot be negative"),
    (history, {"step": [2, 0]}, "history.step[1]", "must not decrease; sort"),
    (history, {"weight": [1.0, 1.1]}, "history.weight[1]", "a weight is a probability"),
    # ids
    (recording, {"landmark": [4, -1, 9]}, "landmark[1]", "id must be >= 0; use landmark=None"),
    (truth, {"landmark_ids": [4, 4]}, "landmark_ids[1]", "distinct"),
    (truth, {"landmark_ids": [4, -9]}, "landmark_ids[1]", ">= 0"),
    (truth, {"association": [4, 5, 9]}, "association[1]", "among landmark_ids"),
    (truth, {"association": [4, -2, 9]}, "association[1]", "among landmark_ids"),
    (truth, {"outlier": [0, 2, 1]}, "outlier[1]", "give 1 for an outlier"),
    (estimate, {"landmark_ids": [9, 9]}, "landmark_ids[1]", "distinct"),
    (estimate, {"association": [4, 5, 9]}, "association[1]", "-1 for a rejected observation"),
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
    # names and figures
    (recording, {"sensor": "lidar"}, "sensor: 'lidar'", "use one of range-bearing, bearing, position"),
    (estimate, {"kind": "predicted"}, "kind: 'predicted'", "use 'filtered' or 'smoothed'"),
    (estimate, {"optimum_check": -0.1}, "optimum_check: -0.1 does not fit; give a number >= 0, or None", ""),
    (estimate, {"optimum_check": math.nan}, "optimum_check: nan does not fit; give a number >= 0, or None", ""),
    (estimate, {"optimum_check": "far"}, "optimum_check: not an array of numbers; ", ""),
    (estimate, {"optimum_check": [0.1, 0.2]}, "optimum_check: shape (2,) does not fit; ", ""),
    (estimate, {"chi_square": math.inf, "chi_square_dof": 4}, "chi_square: inf does not fit", "number >= 0, or None"),
    (estimate, {"chi_square": 1.0, "chi_square_dof": 4.5}, "chi_square_dof: 4.5", "give a whole number >= 0"),
    (estimate, {"chi_square": 1.0}, "chi_square: give chi_square and chi_square_dof together, or neither", ""),
]


@pytest.mark.parametrize(("make", "changes", "start", "words"), RULES)
def test_a_broken_rule_is_one_line_that_names_field_row_and_remedy(
    make: Callable[..., object], changes: dict[str, Any], start: str, words: str
) -> None:
    assert_refused(make, changes, start, words)


def test_the_first_bad_row_is_named_with_its_value() -> None:
    with pytest.raises(ValueError, match=r"^odometry\[1\] = \[0\.1, nan, 0\. \]: "):
        recording(odometry=[[0.1, 0.0, 0.0], [0.1, math.nan, 0.0]])


def test_ids_too_large_for_whole_float64_numbers_are_not_merged_silently() -> None:
    with pytest.raises(UserError, match=r"^landmark\[0\] = .*: every entry must be a whole number below 2\*\*53$"):
        recording(landmark=[2**53, 2**53 + 1, 2**53 + 2])


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


def test_rounding_of_a_symmetric_matrix_is_removed() -> None:
    skewed = np.array([[2.0, 1.0, 0.0], [1.0 + 1e-15, 2.0, 0.0], [0.0, 0.0, 1.0]])
    accepted = recording(prior_cov=skewed).prior_cov
    assert not np.array_equal(skewed, skewed.T)
    assert np.array_equal(accepted, accepted.T)


@EVERY
def test_arrays_are_copied_and_read_only(make: Callable[..., Any]) -> None:
    given = {name: array for name, _, array in arrays_of(make)}
    value = make(**given)
    assert len(given) >= 4
    for name, array in given.items():
        own = getattr(value, name)
        assert not np.shares_memory(own, array)
        with pytest.raises(ValueError, match="read-only"):
            own[...] = 0
        assert own.dtype in (np.float64, np.int64)


@EVERY
def test_records_are_frozen_compared_by_value_and_not_hashable(make: Callable[..., Any]) -> None:
    one, other = make(), make()
    assert one == other
    assert one != 3
    with pytest.raises(TypeError, match="unhashable"):
        hash(one)
    for field in fields(one):
        with pytest.raises(FrozenInstanceError):
            setattr(one, field.name, None)
    assert not hasattr(one, "__dict__")


def test_equal_values_have_equal_gaps_rays_and_histories() -> None:
    gaps = [truth(poses=np.roll([[0, 0, 0], [math.nan] * 3, [0, 0, 0]], k, axis=0)) for k in (0, 0, 1)]
    assert gaps[0] == gaps[1]
    assert gaps[0] != gaps[2]
    assert estimate(rays=rays(), history=history()) == estimate(rays=rays(), history=history())
    assert estimate(rays=rays()) != estimate(rays=rays(members=[3, 5, 3]))
    assert recording() != recording(landmark=None)


def test_errors_of_a_long_recording_name_the_row() -> None:
    many = np.tile(np.eye(2), (150_000, 1, 1))
    np.testing.assert_array_equal(as_covariances("cov", many, (None, 2, 2), definite=True), many)
    many[140_000] = [[1.0, 2.0], [2.0, 1.0]]
    with pytest.raises(UserError, match=r"^cov\[140000\] = .*: a covariance must not have a negative eigenvalue$"):
        as_covariances("cov", many, (None, 2, 2))


def test_covariances_at_the_limits_of_doubles_cause_no_warning() -> None:
    with np.errstate(all="raise", under="ignore"):
        whole = as_covariances("cov", 1.5e308 * np.eye(3)[None], (None, 3, 3))
        np.testing.assert_array_equal(whole, 1.5e308 * np.eye(3)[None])
        with pytest.raises(UserError, match=r"^cov\[0\] = .*: a covariance must not have a negative eigenvalue$"):
            as_covariances("cov", [[[1e-300, 1e308], [1e308, 1e-300]]], (None, 2, 2))


def test_rounding_of_a_singular_covariance_is_removed() -> None:
    """Units differ by 1e8, so that the negative eigenvalue is small compared with the largest."""
    units = np.diag([1e4, 1.0, 1e-4])
    direction = np.array([[1.0, 1.0, 0.5]])
    singular = units @ direction.T @ direction @ units
    rounded = singular - 1e-14 * units @ units
    mended = without_negative_eigenvalues(np.stack([rounded, np.zeros((3, 3)), units @ units]))
    np.testing.assert_array_equal(mended, mended.swapaxes(1, 2))
    correlations = np.linalg.inv(units) @ mended @ np.linalg.inv(units)
    assert np.linalg.eigvalsh(correlations).min() >= -1e-15
    np.testing.assert_allclose(correlations, [direction.T @ direction, np.zeros((3, 3)), np.eye(3)], atol=1e-13)
