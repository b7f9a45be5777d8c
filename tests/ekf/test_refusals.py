"""Online filters refuse invalid input in one line with place, value and remedy; a refusal changes nothing."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.ekf import (
    AssociatingFilter,
    Association,
    BearingFilter,
    Delayed,
    MapManagement,
    Rays,
    Robustness,
    SlamFilter,
)
from slamgauge.ekf.maps.correction_table import RULES, Correction
from slamgauge.errors import UserError
from slamgauge.recording import Observations

START = (np.zeros(3), np.diag([0.01, 0.01, 1e-4]))
NOISE = {2: np.diag([0.01, 0.0076]), 1: np.array([[0.0076]])}
SEEN: dict[int, Float] = {2: np.array([[3.0, 0.1], [4.0, 1.0], [5.0, -1.0]]), 1: np.array([[0.1], [1.0], [-1.0]])}
JCBB = Association("jcbb", map_management=MapManagement())


def with_rule(rule: Correction) -> Callable[[], SlamFilter]:
    return lambda: SlamFilter("range-bearing", *START, rule)


MAKERS: dict[str, tuple[int, bool, Callable[[], Any]]] = {  # dimension, whether it needs ids, constructor
    **{name: (2, True, with_rule(name)) for name in RULES},
    "gate": (2, True, lambda: SlamFilter("range-bearing", *START, robust=Robustness("gate"))),
    "student-t": (2, True, lambda: SlamFilter("range-bearing", *START, robust=Robustness("student-t"))),
    "nearest": (2, False, lambda: AssociatingFilter("range-bearing", *START)),
    "nearest invariant": (2, False, lambda: AssociatingFilter("range-bearing", *START, "right-invariant")),
    "jcbb": (2, False, lambda: AssociatingFilter("range-bearing", *START, "standard", JCBB)),
    "rays": (1, True, lambda: BearingFilter(*START, initialisation=Rays())),
    "delayed": (1, True, lambda: BearingFilter(*START, initialisation=Delayed())),
}
EVERY = pytest.mark.parametrize("name", MAKERS)
IDS = pytest.mark.parametrize("name", [name for name, (_, has_ids, _) in MAKERS.items() if has_ids])


def scan(ids: Any, values: Any, cov: Float) -> Observations:
    return Observations(None if ids is None else np.array(ids), values, np.tile(cov, (len(values), 1, 1)))


def driven(name: str) -> Any:
    """Return a filter that has observed three landmarks for some steps."""
    dim, has_ids, make = MAKERS[name]
    slam = make()
    for _ in range(6):
        slam.predict([0.05, 0.0, 0.01], np.diag([1e-5, 1e-5, 1e-6]))
        slam.update(scan([0, 1, 2] if has_ids else None, SEEN[dim], NOISE[dim]))
    return slam


def believed(slam: Any) -> dict[str, Any]:
    names = "pose", "pose_cov", "landmark_ids", "landmarks", "landmark_covs", "associated", "member_count", "cov"
    return {name: np.array(getattr(slam, name)) for name in names}


def assert_believes(slam: Any, expected: dict[str, Any], what: str = "") -> None:
    for key, value in believed(slam).items():
        np.testing.assert_array_equal(value, expected[key], err_msg=f"{what}: {key}")


def assert_refused(slam: Any, act: Callable[[], object], match: str, what: str = "") -> None:
    before = believed(slam)
    with warnings.catch_warnings(), pytest.raises(UserError, match=match) as refusal:
        warnings.simplefilter("error")
        act()
    assert "\n" not in str(refusal.value)
    assert_believes(slam, before, what)


def assert_continues_as_usual(name: str, slam: Any) -> None:
    """Compare later results with those of a filter that has refused nothing."""
    dim, has_ids, _ = MAKERS[name]
    other = driven(name)
    for _ in range(8):
        for each in (slam, other):
            each.predict([0.3, 0.0, 0.2], np.diag([1e-5, 1e-5, 1e-6]))
            each.update(scan([2, 7, 7] if has_ids else None, SEEN[dim], NOISE[dim]))
    assert_believes(slam, believed(other), "later")


# --- increments ----------------------------------------------------------------------------------

Q = np.eye(3)
INCREMENTS: list[tuple[Any, Any, str]] = [
    ([1.0, 0.2], np.eye(2), r"^increment: shape \(2,\) does not fit; give an increment .*\(v dt, 0, omega dt\)$"),
    ([[1.0, 0.0, 0.0]], Q, r"^increment: shape \(1, 3\) does not fit; give an increment"),
    ([1.0, 0.0, 0.0], [0.1, 0.1, 0.1], r"^increment_cov: shape \(3,\) does not fit; give shape \(3, 3\)"),
    ([1.0, np.nan, 0.0], Q, r"^increment = \[.*nan.*\]: every number must be finite$"),
    ([1.0, 0.0, 0.0], np.diag([1.0, np.inf, 1.0]), r"^increment_cov = .*: every number must be finite$"),
    ([1.0, 0.0, 0.0], -Q, r"^increment_cov = .*: a covariance must not have a negative variance$"),
    ([1.0, 0.0, 0.0], np.ones((3, 3)) - 0.5 * Q, r"^increment_cov = .*: .*negative eigenvalue$"),
    ([1.0, 0.0, 0.0], Q + np.eye(3, k=1) / 2, r"^increment_cov = .*: a covariance must be symmetric"),
    ([1e60, 0.0, 0.0], Q, r"^increment = .*: a number must be below 1e\+50"),
    ([0.0, 0.0, 0.0], 1e200 * Q, r"^increment"),
]


@EVERY
def test_refused_increments_change_nothing(name: str) -> None:
    slam = driven(name)
    for increment, cov, match in INCREMENTS:
        assert_refused(slam, lambda u=increment, cov=cov: slam.predict(u, cov), match)
    assert_continues_as_usual(name, slam)


@EVERY
def test_an_entry_next_to_a_zero_variance_is_accepted(name: str) -> None:
    cov = np.diag([0.01, 0.0, 1e-4])
    cov[1, 2] = cov[2, 1] = 1e-8
    driven(name).predict([0.1, 0.0, 0.01], cov)


# --- scans ---------------------------------------------------------------------------------------


def changed(array: Float, place: tuple[int, ...], value: float) -> Float:
    copied = array.copy()
    copied[place] = value
    return copied


SHAPE = r"^(observation|observation_cov|landmark): [^;]*does not fit; give shape|^landmark: 3 ids for [12]"
FAULTS: dict[str, tuple[Callable[[Float, Float], tuple[Any, Any]], str]] = {  # changes of values and covariances
    "nan": (lambda z, R: (changed(z, (1, 0), np.nan), R), r"^observation\[1\] = .*nan.*: every number must be finite$"),
    "range": (lambda z, R: (changed(z, (1, 0), -2.0), R), r"^observation\[1\] = .*: a range cannot be negative; drop"),
    "inf": (lambda z, R: (z, changed(R, (1, 0, 0), np.inf)), r"^observation_cov\[1\] = .*inf.*: every number must be"),
    "negative": (lambda z, R: (z, changed(R, (1, 0, 0), -1.0)), r"^observation_cov\[1\] = .* not have a negative var"),
    "zero": (lambda z, R: (z, changed(R, (1, 0, 0), 0.0)), r"^observation_cov\[1\] = .*: .*be positive definite here"),
    "asymmetric": (lambda z, R: (z, changed(R, (1, 0, 1), 1e-4)), r"^observation_cov\[1\] = .*: .*be symmetric; use"),
    "one value": (lambda z, R: (z[:1], R), SHAPE),
    "one cov": (lambda z, R: (z, R[:1]), SHAPE),
    "width": (lambda z, R: (np.repeat(z, 2, axis=1), R), SHAPE),
    "flat": (lambda z, R: (z[:, 0], R[:, 0, 0]), SHAPE),
    "large": (lambda z, R: (changed(z, (2, 0), 1e308), R), r"^observation\[2\] = .*: a number must be below 1e\+50"),
    "far": (lambda z, R: (changed(z, (2, 0), 1e155), R), r"^observation\[2\] = .*: a number must be below 1e\+50"),
    "vague": (lambda z, R: (z, 1e300 * R), r"^observation_cov\[0\] = .*: a number must be below 1e\+50"),
}
ONE_ID = r"^landmark: this filter needs known association; give the ids"
INVALID_IDS: list[tuple[Any, str]] = [
    (None, ONE_ID),
    ([0, 1], r"^landmark: 2 ids for 3 observations; give one for each$"),
    ([0.0, 1.5, 2.0], r"^landmark\[1\] = 1.5: every entry must be a whole number"),
    (np.array([2**63 + 5, 1, 2], dtype=np.uint64), r"^landmark\[0\] = .*: every entry must be a whole number"),
    ([0, 1, -1], r"^landmark\[2\] = -1: an id must be >= 0"),
    ([0, 1, -2], r"^landmark\[2\] = -2: an id must be >= 0"),  # members of rays have such ids inside the map
    ([[0], [1], [2]], r"^landmark: shape \(3, 1\) does not fit; give shape \(any,\)$"),
]


@EVERY
@pytest.mark.parametrize("ids", [[0, 1, 2], [0, 1, 9], [8, 9, 9]], ids=["mapped", "one new", "new"])
def test_refused_scans_change_nothing(name: str, ids: list[int]) -> None:
    dim, has_ids, _ = MAKERS[name]
    slam = driven(name)
    for fault, (change, match) in FAULTS.items():
        if dim == 1 and fault in ("range", "asymmetric"):
            continue
        values, covs = change(SEEN[dim], np.tile(NOISE[dim], (3, 1, 1)))
        given = Observations(np.array(ids) if has_ids else None, values, covs)
        assert_refused(slam, lambda given=given: slam.update(given), match, fault)
    assert_continues_as_usual(name, slam)


@IDS
def test_refused_ids_change_nothing(name: str) -> None:
    slam, dim = driven(name), MAKERS[name][0]
    for ids, match in INVALID_IDS:
        given = scan(ids, SEEN[dim], NOISE[dim])
        assert_refused(slam, lambda given=given: slam.update(given), match)
    assert_continues_as_usual(name, slam)


# objects of every kind that numpy accepts; tests give them as increments (3,), covariances, values and ids
NO_NUMBERS: dict[str, Any] = {
    "letters": np.array(["a", "b", "c"]),
    "digits": np.array(["1", "2", "3"]),
    "list of letters": ["a", "b", "c"],
    "complex": np.array([1.0 + 2.0j, 0.0, 0.0]),
    "ragged": [[1.0, 2.0], [3.0]],
    "dates": np.array(["2020-01-01"] * 3, dtype="datetime64[s]"),
    "scalar": 1.0,
    "none": None,
    "objects": np.array([1.0, None, "c"], dtype=object),
    "a table": {"x": 1.0},
}


@EVERY
@pytest.mark.parametrize("given", NO_NUMBERS.values(), ids=NO_NUMBERS)
def test_arrays_of_other_types(name: str, given: Any) -> None:
    slam, (dim, has_ids, _) = driven(name), MAKERS[name]
    usual = scan([0, 1, 2] if has_ids else None, SEEN[dim], NOISE[dim])
    square, rows, squares = given, given, given
    if isinstance(given, np.ndarray):
        square, rows, squares = np.tile(given, (3, 1)), np.tile(given, (dim, 1)).T, np.tile(given, (dim, dim, 1)).T
    refusal = r"^{}: (not an array of numbers|shape \(\) does not fit); give "
    assert_refused(slam, lambda: slam.predict(given, Q), refusal.format("increment"))
    assert_refused(slam, lambda: slam.predict(np.zeros(3), square), refusal.format("increment_cov"))
    assert_refused(slam, lambda: slam.update(usual._replace(value=rows)), refusal.format("observation"))
    assert_refused(slam, lambda: slam.update(usual._replace(cov=squares)), refusal.format("observation_cov"))
    assert_refused(slam, lambda: slam.update(given), "^observations: .* is not a scan; give slamgauge.Observations")
    if has_ids:
        rule = f"{refusal.format('landmark')}|{ONE_ID}"
        assert_refused(slam, lambda: slam.update(usual._replace(landmark=given)), rule)


@EVERY
@pytest.mark.parametrize("empty", [[], np.zeros(0), ()], ids=["list", "array", "tuple"])
def test_empty_lists_are_empty_scans(name: str, empty: Any) -> None:
    slam = driven(name)
    before = {**believed(slam), "associated": []}
    assert slam.update(Observations(empty, empty, empty)) == (0.0, 0)
    assert_believes(slam, before)


@IDS
@pytest.mark.parametrize("kind", [list, np.uint8, np.uint64, np.int32, np.float64])
def test_lists_and_whole_numbers_of_any_type_are_accepted(name: str, kind: Any) -> None:
    arrays, others, dim = driven(name), driven(name), MAKERS[name][0]
    ids, values, covs = scan([0, 1, 2], SEEN[dim], NOISE[dim])
    assert ids is not None
    arrays.update(Observations(ids, values, covs))
    if kind is list:
        others.update(Observations(ids.tolist(), values.tolist(), covs.tolist()))  # pyrefly: ignore[bad-argument-type]
    else:
        others.update(Observations(ids.astype(kind), values, covs))
    assert_believes(others, believed(arrays))


@pytest.mark.parametrize("name", RULES)
def test_a_refused_later_block_undoes_the_first(name: str) -> None:
    """41 observations are three blocks; the last two, of one landmark, are too precise for double precision."""
    slam, rng, ids = MAKERS[name][2](), np.random.default_rng(0), np.arange(40)
    values = np.column_stack([rng.uniform(5.0, 9.0, 40), np.linspace(-3.0, 3.0, 40)])
    covs = np.tile(NOISE[2], (40, 1, 1))
    slam.update(Observations(ids, values, covs))
    slam.predict(np.zeros(3), np.diag([1.0, 1.0, 1e-3]))
    again = [*range(40), 39]
    covs = covs[again]
    covs[-2:] *= 1e-20
    given = Observations(ids[again], values[again], covs)
    assert_refused(slam, lambda: slam.update(given), r"^observation: no update exists for this scan; ")


@IDS
def test_a_landmark_may_be_observed_many_times_in_a_scan(name: str) -> None:
    """More often than Python's recursion is deep, for bearings, which are processed one after the other."""
    dim, _, make = MAKERS[name]
    slam, times = make(), 1100 if dim == 1 else 200
    slam.update(scan([5] * times, np.tile(SEEN[dim][1], (times, 1)), NOISE[dim]))
    assert np.isfinite(slam.pose_cov).all()
    assert name != "rays" or slam.provisional == {5: 3} or len(slam.landmark_ids) == 1


def test_a_map_that_needs_too_much_memory_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    slam = driven("standard")
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 100_000.0)
    given = scan([*range(200, 400)], np.column_stack([np.full(200, 5.0), np.linspace(-3.0, 3.0, 200)]), NOISE[2])
    match = r"^the covariance of 203 landmarks or members of rays needs 0.0 GB of memory"
    assert_refused(slam, lambda: slam.update(given), match)


# --- gates ---------------------------------------------------------------------------------------


def bearings_of_points() -> tuple[BearingFilter, Float]:
    """Return a filter with three points, and their last bearings."""
    slam, landmarks, bearings = BearingFilter(np.zeros(3), np.zeros((3, 3))), SEEN[2], np.zeros((3, 1))
    for k in range(40):
        if k:
            slam.predict([0.1, 0.0, 0.0], np.diag([1e-6, 1e-6, 1e-8]))
        offset = landmarks @ [[1.0, 1.0], [1.0, -1.0]] - [0.1 * k, 0.0]
        bearings = np.arctan2(offset[:, 1], offset[:, 0])[:, None]
        slam.update(scan([0, 1, 2], bearings, 1e-4 * np.eye(1)))
    assert not slam.provisional
    return slam, bearings


@pytest.mark.parametrize("dim", [1, 2])
def test_observations_beyond_the_gate_are_rejected(dim: int) -> None:
    """The result equals that without them; `associated` has -1 for them."""
    (gated, values), (told, _) = (bearings_of_points() if dim == 1 else (driven("standard"), SEEN[2]) for _ in range(2))
    values = values.copy()
    values[1] += [0.3] if dim == 1 else [2.0, 0.0]
    ids, cov = np.array([0, 1, 9]), 1e-4 * np.eye(1) if dim == 1 else NOISE[2]
    result = gated.update(scan(ids, values, cov), gate=20.0)
    assert result == told.update(scan(ids[[0, 2]], values[[0, 2]], cov))
    assert gated.associated.tolist() == [0, -1, 9]
    assert_believes(gated, {**believed(told), "associated": [0, -1, 9]})


@pytest.mark.parametrize("name", ["standard", "rays"])
@pytest.mark.parametrize("gate", [0.0, -1.0, np.nan, np.inf, "9", [9.0], True], ids=str)
def test_invalid_gates(name: str, gate: Any) -> None:
    slam, dim = driven(name), MAKERS[name][0]
    with pytest.raises(UserError, match=r"^gate: \S+ (is out of range|is not a finite.*); choose it above 0$") as rule:
        Association(gate=gate)
    act = slam.update
    assert_refused(
        slam, lambda: act(scan([0, 1, 2], SEEN[dim], NOISE[dim]), gate=gate), f"^{re.escape(str(rule.value))}$"
    )


# --- constructors --------------------------------------------------------------------------------

MEAN, COV = np.array([0.1, 0.2, 0.3]), 1e-4 * np.eye(3)
KINDS: tuple[Any, ...] = (
    lambda mean, cov, **more: SlamFilter("position", mean, cov, **more),
    lambda mean, cov, **more: AssociatingFilter("position", mean, cov, **more),
    BearingFilter,
)
NAMED: Any = (SlamFilter, AssociatingFilter)
NOT_A_NUMBER = r"landmarks: \S+ is not a number of landmarks; give a whole number, at least 0"
SENSOR = r"sensor: .* does not fit this filter; use one of range-bearing, [^\n]*"
PRIORS = [
    ([0.0, 0.0], np.eye(3), r"prior_mean: shape \(2,\) does not fit; give shape \(3,\)"),
    ([0.0, np.inf, 0.0], np.eye(3), r"prior_mean\[1\] = inf: every number must be finite"),
    (MEAN, [0.1, 0.2, 0.3], r"prior_cov: shape \(3,\) does not fit; give shape \(3, 3\)"),
    (MEAN, -np.eye(3), r"prior_cov\[0\] = .*: a covariance must not have a negative variance"),
    (["1", "2", "3"], np.eye(3), r"prior_mean: not an array of numbers; give shape \(3,\)"),
    (np.zeros(3) * 1j, np.eye(3), r"prior_mean: not an array of numbers; give shape \(3,\)"),
    (None, np.eye(3), r"prior_mean: shape \(\) does not fit; give shape \(3,\)"),
    (MEAN, "large", r"prior_cov: not an array of numbers; give shape \(3, 3\)"),
    (MEAN, [[1.0], [0.0, 1.0]], r"prior_cov: not an array of numbers; give shape \(3, 3\)"),
]
CORRECTION = [
    ("riekf", r"the estimator of that name uses 'right-invariant'"),
    ("oc-ekf", r"the estimator of that name uses 'observability-constrained'"),
    ("right-invarient", r"did you mean right-invariant\?"),
    ("ukf", r"use one of standard, .*right-invariant"),
]
REFUSED = [
    *((KINDS, (mean, cov), {}, match) for mean, cov, match in PRIORS),
    *((KINDS, (MEAN, COV), {"correction": x}, f"correction: '{x}' is not known; {remedy}") for x, remedy in CORRECTION),
    *((NAMED, (x, MEAN, COV), {}, SENSOR) for x in (None, ["position"], np.array(["position"] * 2), "sonar")),
    *((KINDS[:1], (MEAN, COV), {"landmarks": x}, NOT_A_NUMBER) for x in (-1, 1.5, 3.0, "3", None, True, [3])),
    (NAMED[1:], ("bearing", MEAN, COV), {}, "sensor: 'bearing' does not fit this filter; use one of .*, position"),
    (
        KINDS[1:2],
        (MEAN, COV),
        {"association": "jcbb"},
        r"association: 'jcbb' is not an Association; give Association.*",
    ),
    (KINDS, (MEAN, COV), {"robust": "gate"}, r"robust: 'gate' is not a Robustness; give Robustness\('gate'\).*"),
    ((Association,), ("jcb",), {}, r"method: 'jcb' is not known; did you mean jcbb\?"),
]


@pytest.mark.parametrize(("makers", "arguments", "more", "match"), REFUSED)
def test_invalid_arguments(
    makers: tuple[Any, ...], arguments: tuple[Any, ...], more: dict[str, Any], match: str
) -> None:
    for make in makers:
        with pytest.raises(UserError, match=f"^{match}$"):
            make(*arguments, **more)
