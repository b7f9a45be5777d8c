"""Online filters refuse invalid input in one line with place, value and remedy, and do not change."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from slamgauge.arrays import Float, Int
from slamgauge.ekf import (
    AssociatingFilter,
    Association,
    BearingFilter,
    MapManagement,
    OnlineFilter,
    SlamFilter,
)
from slamgauge.errors import UserError
from slamgauge.recording import Observations, Recording

START = (np.array([0.1, 0.2, 0.3]), 1e-4 * np.eye(3))
JCBB, MANAGED = Association("jcbb"), Association("jcbb", map_management=MapManagement())
FILTERS: dict[str, Callable[[], OnlineFilter]] = {
    "SlamFilter": lambda: SlamFilter("range-bearing", *START),
    "nearest neighbour": lambda: AssociatingFilter("range-bearing", *START),
    "jcbb": lambda: AssociatingFilter("range-bearing", *START, association=JCBB),
    "managed": lambda: AssociatingFilter("range-bearing", *START, association=MANAGED),
    "BearingFilter": lambda: BearingFilter(*START),
}
EVERY = pytest.mark.parametrize("kind", FILTERS)
IDS = pytest.mark.parametrize("kind", ["SlamFilter", "BearingFilter"])


def scan(kind: str, count: int = 3, first: int = 0) -> Observations:
    """Return observations of landmarks around the robot."""
    ids = np.arange(first, first + count)
    values: Float = np.column_stack([3.0 + ids, -1.0 + 0.7 * ids]).astype(np.float64)
    covs = np.tile(np.diag([0.1, 0.05]) ** 2, (count, 1, 1))
    if kind.startswith("Bearing"):
        values, covs = values[:, 1:], covs[:, 1:, 1:]
    return Observations(ids, values, covs)


def started(kind: str) -> OnlineFilter:
    """Return a filter with landmarks, of which it has just observed some."""
    slam = FILTERS[kind]()
    for _ in range(3):
        slam.update(scan(kind))
        slam.predict([0.1, 0.0, 0.01], np.diag([1e-4, 0.0, 1e-6]))
    slam.update(scan(kind, count=2))
    return slam


refusing = cache(started)  # one filter of each kind is enough, because refusals change nothing


def belief_of(slam: OnlineFilter) -> list[Float | Int]:
    whole = getattr(slam, "cov", slam.pose_cov)
    return [slam.pose, slam.pose_cov, whole, slam.landmark_ids, slam.landmarks, slam.landmark_covs, slam.associated]


def assert_same(actual: list[Float | Int], expected: list[Float | Int]) -> None:
    for one, other in zip(actual, expected, strict=True):
        np.testing.assert_array_equal(one, other)


def assert_refused(kind: str, act: Callable[[OnlineFilter], object], match: str) -> None:
    slam = refusing(kind)
    before = belief_of(slam)
    with warnings.catch_warnings(), pytest.raises(UserError, match=match) as refusal:
        warnings.simplefilter("error")
        act(slam)
    assert "\n" not in str(refusal.value)
    assert_same(belief_of(slam), before)


# --- increments ----------------------------------------------------------------------------------


@EVERY
@pytest.mark.parametrize(
    ("increment", "cov", "match"),
    [
        (
            [1.0, 0.2],
            np.eye(2),
            r"^increment: shape \(2,\) .*of controls \(v, omega\) over dt .*\(v dt, 0, omega dt\)$",
        ),
        (np.ones((2, 1)), np.eye(2), r"^increment: shape \(2, 1\) .*\(v dt, 0, omega dt\)$"),
        ([[1.0, 0.0, 0.0]], np.eye(3), r"^increment: shape \(1, 3\) does not fit; give an increment"),
        ([1.0, 0.0, 0.0], [0.1, 0.1, 0.1], r"^increment_cov: shape \(3,\) does not fit; give shape \(3, 3\)"),
        ([1.0, np.nan, 0.0], np.eye(3), r"^increment = \[.*nan.*\]: every number must be finite$"),
        ([1.0, 0.0, 0.0], np.diag([1.0, np.inf, 1.0]), r"^increment_cov = .*: every number must be finite$"),
        ([1.0, 0.0, 0.0], -np.eye(3), r"^increment_cov = .*: a covariance must not have a negative variance$"),
        ([1.0, 0.0, 0.0], np.ones((3, 3)) - 0.5 * np.eye(3), r"^increment_cov = .*: .*negative eigenvalue$"),
        ([1.0, 0.0, 0.0], np.eye(3) + np.eye(3, k=1) / 2, r"^increment_cov = .*: a covariance must be symmetric"),
    ],
)
def test_invalid_increments(kind: str, increment: object, cov: object, match: str) -> None:
    assert_refused(kind, lambda slam: slam.predict(increment, cov), match)  # pyrefly: ignore[bad-argument-type]


# objects of every kind that numpy accepts; tests give them as increments (3,), covariances, values and ids
NO_NUMBERS: dict[str, object] = {
    "letters": np.array(["a", "b", "c"]),
    "digits": np.array(["1", "2", "3"]),
    "list of letters": ["a", "b", "c"],
    "complex": np.array([1.0 + 2.0j, 0.0, 0.0]),
    "list of complex": [1.0 + 2.0j, 0.0, 0.0],
    "ragged": [[1.0, 2.0], [3.0]],
    "dates": np.array(["2020-01-01"] * 3, dtype="datetime64[s]"),
    "scalar": 1.0,
    "none": None,
    "objects": np.array([1.0, None, "c"], dtype=object),
    "a table": {"x": 1.0},
}


@EVERY
@pytest.mark.parametrize("given", NO_NUMBERS.values(), ids=NO_NUMBERS)
def test_arrays_of_other_types(kind: str, given: Any) -> None:
    ids, values, covs = scan(kind)
    dim = values.shape[1]
    square, rows, squares = given, given, given
    if isinstance(given, np.ndarray):
        square, rows, squares = np.tile(given, (3, 1)), np.tile(given, (dim, 1)).T, np.tile(given, (dim, dim, 1)).T
    refusal = r"^{}: (not an array of numbers|shape \(\) does not fit{}); give {}"
    increment = refusal.format("increment", "", r"an increment \(dx, dy, dtheta\)")
    assert_refused(kind, lambda slam: slam.predict(given, np.eye(3)), increment)
    increment_cov = refusal.format("increment_cov", "", r"shape \(3, 3\)")
    assert_refused(kind, lambda slam: slam.predict(np.zeros(3), square), increment_cov)
    value = refusal.format("observation", " this sensor", "shape")
    assert_refused(kind, lambda slam: slam.update(Observations(ids, rows, covs)), value)
    cov = refusal.format("observation_cov", " 3 observations", r"shape \(3, ")
    assert_refused(kind, lambda slam: slam.update(Observations(ids, values, squares)), cov)


@EVERY
def test_an_entry_next_to_a_zero_variance_is_accepted_as_in_a_recording(kind: str) -> None:
    Q = np.diag([0.01, 0.0, 1e-4])
    Q[1, 2] = Q[2, 1] = 1e-8
    odometry = np.array([[0.1, 0.0, 0.01]])
    empty = np.zeros(0, dtype=np.int64)
    recording = Recording(
        np.arange(2.0), *START, odometry, Q[None], "position", empty, np.zeros((0, 2)), np.zeros((0, 2, 2)), empty
    )
    started(kind).predict(recording.odometry[0], recording.odometry_cov[0])


# --- observations --------------------------------------------------------------------------------


def changed(array: Float, place: tuple[int, ...], value: float) -> Float:
    copied = array.copy()
    copied[place] = value
    return copied


def other_width(values: Float) -> Float:
    """Return bearings with ranges, or observations without their second number."""
    return np.repeat(values, 2, axis=1) if values.shape[1] == 1 else values[:, :1]


SHAPE = r"^(observation|observation_cov|landmark): [^;]*does not fit [^;]*; give shape|^landmark: 3 ids for 1"
BROKEN: dict[str, tuple[Callable[[Float, Float], tuple[Float, Float]], str]] = {
    "nan": (
        lambda values, covs: (changed(values, (1, 0), np.nan), covs),
        r"^observation\[1\] = .*nan.*: every number must be finite$",
    ),
    "range": (
        lambda values, covs: (changed(values, (1, 0), -2.0), covs),
        r"^observation\[1\] = .*: a range cannot be negative; drop the row$",
    ),
    "variance": (
        lambda values, covs: (values, changed(covs, (1, 0, 0), -1.0)),
        r"^observation_cov\[1\] = .*: a covariance must not have a negative variance$",
    ),
    "inf cov": (
        lambda values, covs: (values, changed(covs, (1, 0, 0), np.inf)),
        r"^observation_cov\[1\] = .*inf.*: every number must be finite$",
    ),
    "no variance": (
        lambda values, covs: (values, changed(covs, (1, 0, 0), 0.0)),
        r"^observation_cov\[1\] = .*: a covariance must be positive definite here; raise its variances$",
    ),
    "asymmetric": (
        lambda values, covs: (values, changed(covs, (1, 0, 1), 1e-4)),
        r"^observation_cov\[1\] = .*: a covariance must be symmetric; use \(P \+ P.T\) / 2$",
    ),
    "one value": (lambda values, covs: (values[:1], covs), SHAPE),
    "one cov": (lambda values, covs: (values, covs[:1]), SHAPE),
    "width": (lambda values, covs: (other_width(values), covs), SHAPE),
    "widths": (lambda values, covs: (other_width(values), np.tile(np.eye(3 - len(covs[0])), (3, 1, 1))), SHAPE),
    "flat": (lambda values, covs: (values[:, 0], covs[:, 0, 0]), SHAPE),
}


@EVERY
@pytest.mark.parametrize("mapped", [True, False], ids=["mapped", "new"])
@pytest.mark.parametrize("fault", BROKEN)
def test_invalid_observations(kind: str, mapped: bool, fault: str) -> None:
    if kind.startswith("Bearing") and fault in ("range", "asymmetric"):
        return
    break_it, match = BROKEN[fault]
    ids, values, covs = scan(kind, first=0 if mapped else 10)
    broken = Observations(ids, *break_it(values, covs))
    assert_refused(kind, lambda slam: slam.update(broken), match)


@IDS
@pytest.mark.parametrize("given", [*NO_NUMBERS.values(), 7], ids=[*NO_NUMBERS, "one"])
def test_ids_of_other_types(kind: str, given: object) -> None:
    broken = scan(kind)._replace(landmark=given)  # pyrefly: ignore[bad-argument-type]
    refusal = r"^landmark: (not an array of numbers|shape \(\) does not fit|this filter needs known association); give"
    assert_refused(kind, lambda slam: slam.update(broken), refusal)


@EVERY
@pytest.mark.parametrize("given", [None, 3, [[1.0, 2.0]], (np.arange(3), np.zeros((3, 2)))], ids=str)
def test_other_objects_than_scans(kind: str, given: object) -> None:
    refusal = r"^observations: a \w+ is not a scan; give slamgauge.Observations\(landmark, value, cov\)$"
    assert_refused(kind, lambda slam: slam.update(given), refusal)  # pyrefly: ignore[bad-argument-type]


@EVERY
@pytest.mark.parametrize("empty", [[], np.zeros(0), ()], ids=["list", "array", "tuple"])
def test_empty_lists_are_empty_scans(kind: str, empty: object) -> None:
    slam = started(kind)
    before = belief_of(slam)
    assert slam.update(Observations(empty, empty, empty)) == (0.0, 0)  # pyrefly: ignore[bad-argument-type]
    assert_same(belief_of(slam)[:-1], before[:-1])
    assert len(slam.associated) == 0


@IDS
@pytest.mark.parametrize(
    ("ids", "match"),
    [
        (None, r"^landmark: this filter needs known association; give the ids"),
        ([0, 1], r"^landmark: 2 ids for 3 observations; give one for each$"),
        ([0, 1, 2, 3], r"^landmark: 4 ids for 3 observations; give one for each$"),
        ([0.0, 1.5, 2.0], r"^landmark\[1\] = 1.5: every entry must be a whole number"),
        ([0, 1, -1], r"^landmark\[2\] = -1: an id must be >= 0"),
        ([[0], [1], [2]], r"^landmark: shape \(3, 1\) does not fit; give shape \(any,\)$"),
    ],
)
def test_invalid_ids(kind: str, ids: list[float] | None, match: str) -> None:
    given = None if ids is None else np.array(ids)
    assert_refused(kind, lambda slam: slam.update(scan(kind)._replace(landmark=given)), match)


@IDS
@pytest.mark.parametrize("kind_of_ids", [list, np.uint8, np.uint64, np.int32, np.float64])
def test_lists_and_whole_numbers_of_any_type_are_accepted(kind: str, kind_of_ids: type) -> None:
    arrays, others = started(kind), started(kind)
    ids, (_, values, covs) = np.arange(3), scan(kind)
    arrays.update(Observations(ids, values, covs))
    if kind_of_ids is list:
        others.update(Observations(ids.astype(float).tolist(), values.tolist(), covs.tolist()))  # pyrefly: ignore[bad-argument-type]
    else:
        others.update(Observations(ids.astype(kind_of_ids), values, covs))
    assert_same(belief_of(arrays), belief_of(others))


# --- outliers ------------------------------------------------------------------------------------


def test_observations_beyond_the_gate_are_rejected() -> None:
    """The result equals that without them; `associated` has -1 for them."""
    wide, gated, told = started("SlamFilter"), started("SlamFilter"), started("SlamFilter")
    assert isinstance(gated, SlamFilter)
    ids, (_, values, covs) = np.arange(5), scan("SlamFilter", count=5)  # two are new
    values[:3] += [[0.0, 0.0], [2.0, 0.0], [0.0, 0.01]]
    kept = np.array([0, 2, 3, 4])
    result = gated.update(Observations(ids, values, covs), gate=20.0)
    assert result == told.update(Observations(ids[kept], values[kept], covs[kept]))
    assert gated.associated.tolist() == [0, -1, 2, 3, 4]
    assert isinstance(wide, SlamFilter)
    assert wide.update(scan("SlamFilter"), gate=1e50) == started("SlamFilter").update(scan("SlamFilter"))
    assert_same(belief_of(gated)[:-1], belief_of(told)[:-1])


def test_bearings_of_points_beyond_the_gate_are_rejected() -> None:
    gated, told = (BearingFilter(np.zeros(3), np.zeros((3, 3))) for _ in range(2))
    landmarks = np.array([[3.0, 3.0], [2.0, -4.5], [4.0, 2.0]])
    bearings = np.zeros((3, 1))
    for k in range(40):
        offset = landmarks - [0.1 * k, 0.0]
        bearings = np.arctan2(offset[:, 1], offset[:, 0])[:, None]
        for slam in (gated, told):
            if k:
                slam.predict([0.1, 0.0, 0.0], np.diag([1e-6, 1e-6, 1e-8]))
            slam.update(Observations(np.arange(3), bearings, np.full((3, 1, 1), 1e-4)))
    assert not gated.provisional
    bearings[1] += 0.3
    ids, covs = np.array([0, 1, 9]), np.full((3, 1, 1), 1e-4)
    assert gated.update(Observations(ids, bearings, covs), gate=9.0) == told.update(
        Observations(ids[[0, 2]], bearings[[0, 2]], covs[:2])
    )
    assert gated.associated.tolist() == [0, -1, 9]
    assert_same(belief_of(gated)[:-1], belief_of(told)[:-1])


@pytest.mark.parametrize("kind", ["SlamFilter", "BearingFilter"])
@pytest.mark.parametrize("gate", [0.0, -1.0, np.nan, np.inf, "9", [9.0], True], ids=str)
def test_invalid_gates(kind: str, gate: object) -> None:
    def act(slam: OnlineFilter) -> None:
        assert isinstance(slam, (SlamFilter, BearingFilter))
        slam.update(scan(kind), gate=gate)  # pyrefly: ignore[bad-argument-type]

    assert_refused(kind, act, r"^gate: \S+ (is out of range|is not a finite number); choose it above 0$")
    with pytest.raises(UserError) as refusal:
        Association(gate=gate)  # pyrefly: ignore[bad-argument-type]
    assert_refused(kind, act, f"^{re.escape(str(refusal.value))}$")  # the same rule
