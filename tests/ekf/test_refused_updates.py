"""A refused update changes nothing: pose, covariance, map, internal records and later results."""

from __future__ import annotations

import pickle
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
from slamgauge.ekf.maps.correction_table import RULES, Rule
from slamgauge.errors import UserError
from slamgauge.recording import Observations

START = (np.zeros(3), np.diag([0.01, 0.01, 1e-4]))
NOISE = {2: np.diag([0.01, 0.0076]), 1: np.array([[0.0076]])}
SEEN: dict[int, Float] = {2: np.array([[3.0, 0.1], [4.0, 1.0], [5.0, -1.0]]), 1: np.array([[0.1], [1.0], [-1.0]])}


def with_rule(rule: Rule) -> Callable[[], SlamFilter]:
    return lambda: SlamFilter("range-bearing", *START, rule)


MAKERS: dict[str, tuple[int, bool, Callable[[], Any]]] = {  # dimension, whether it needs ids, constructor
    **{name: (2, True, with_rule(rule)) for name, rule in RULES.items()},
    "gate": (2, True, lambda: SlamFilter("range-bearing", *START, robust=Robustness("gate"))),
    "student-t": (2, True, lambda: SlamFilter("range-bearing", *START, robust=Robustness("student-t"))),
    "nearest": (2, False, lambda: AssociatingFilter("range-bearing", *START)),
    "nearest invariant": (2, False, lambda: AssociatingFilter("range-bearing", *START, "right-invariant")),
    "jcbb": (2, False, lambda: AssociatingFilter("range-bearing", *START, "standard", JCBB)),
    "rays": (1, True, lambda: BearingFilter(*START, initialisation=Rays())),
    "delayed": (1, True, lambda: BearingFilter(*START, initialisation=Delayed())),
}
JCBB = Association("jcbb", map_management=MapManagement())


def scan(ids: list[int] | None, values: Any, cov: Float) -> Observations:
    rows = np.asarray(values, dtype=np.float64)
    return Observations(None if ids is None else np.array(ids), rows, np.tile(cov, (len(rows), 1, 1)))


def driven(name: str) -> Any:
    """Return a filter that has observed three landmarks for some steps."""
    dim, has_ids, make = MAKERS[name]
    slam = make()
    for _ in range(6):
        slam.predict([0.05, 0.0, 0.01], np.diag([1e-5, 1e-5, 1e-6]))
        slam.update(scan([0, 1, 2] if has_ids else None, SEEN[dim], NOISE[dim]))
    return slam


def believed(slam: Any) -> dict[str, Any]:
    names = ("pose", "pose_cov", "landmark_ids", "landmarks", "landmark_covs", "associated", "member_count")
    return {name: np.array(getattr(slam, name)) for name in (*names, *(["cov"] if hasattr(slam, "cov") else []))}


def assert_believes(slam: Any, expected: dict[str, Any], what: str = "") -> None:
    for key, value in believed(slam).items():
        np.testing.assert_array_equal(value, expected[key], err_msg=f"{what}: {key}")


def beyond(name: str) -> dict[str, Observations]:
    """Return scans that every filter refuses, by their fault."""
    dim, has_ids, _ = MAKERS[name]
    large, far = SEEN[dim].copy(), SEEN[dim].copy()
    large[2, 0], far[2, 0] = 1e308, 1e155

    def with_ids(*ids: int) -> list[int] | None:
        return [*ids] if has_ids else None

    scans = {
        "large": scan(with_ids(0, 1, 2), large, NOISE[dim]),
        "large and new": scan(with_ids(0, 1, 9), large, NOISE[dim]),
        "far and twice": scan(with_ids(0, 9, 9), far, NOISE[dim]),
        "vague": scan(with_ids(8, 9, 9), SEEN[dim], 1e300 * NOISE[dim]),
    }
    if has_ids:
        scans["negative id"] = scan([0, 1, -5], SEEN[dim], NOISE[dim])
        scans["half an id"] = scans["negative id"]._replace(landmark=np.array([0.5, 1.0, 2.0]))
        scans["vast id"] = scans["negative id"]._replace(landmark=np.array([2**63 + 5, 1, 2], dtype=np.uint64))  # pyrefly: ignore[bad-argument-type]
    return scans


@pytest.mark.parametrize("name", MAKERS)
def test_refused_scans_change_nothing(name: str):
    dim, has_ids, _ = MAKERS[name]
    for what, given in beyond(name).items():
        slam, other = driven(name), driven(name)
        before = believed(slam)
        with pytest.raises(UserError, match=r"^[^\n]+$"):
            slam.update(given)
        assert_believes(slam, before, what)
        for _ in range(8):  # later results are the same
            for each in (slam, other):
                each.predict([0.3, 0.0, 0.2], np.diag([1e-5, 1e-5, 1e-6]))
                each.update(scan([2, 7, 7] if has_ids else None, SEEN[dim], NOISE[dim]))
        assert_believes(slam, believed(other), f"{what}, later")


@pytest.mark.parametrize("name", RULES)
def test_a_refused_later_block_undoes_the_first(name: str):
    """41 observations are three blocks; the last two, of one landmark, are too precise for double precision."""
    slam = MAKERS[name][2]()
    rng = np.random.default_rng(0)
    ids = np.arange(40)
    values = np.column_stack([rng.uniform(5.0, 9.0, 40), np.linspace(-3.0, 3.0, 40)])
    covs = np.tile(NOISE[2], (40, 1, 1))
    slam.update(Observations(ids, values, covs))
    slam.predict(np.zeros(3), np.diag([1.0, 1.0, 1e-3]))
    before = believed(slam)
    again = [*range(40), 39]
    covs = covs[again]
    covs[-2:] *= 1e-20
    with pytest.raises(UserError, match=r"^observation: no update exists for this scan; [^\n]+$"):
        slam.update(Observations(ids[again], values[again], covs))
    assert_believes(slam, before)


@pytest.mark.parametrize("name", [name for name, (_, has_ids, _) in MAKERS.items() if has_ids])
def test_a_landmark_may_be_observed_many_times_in_a_scan(name: str):
    """More often than Python's recursion is deep, for bearings, which are processed one after the other."""
    dim, _, make = MAKERS[name]
    slam, times = make(), 1100 if dim == 1 else 200
    slam.update(scan([5] * times, np.tile(SEEN[dim][1], (times, 1)), NOISE[dim]))
    assert np.isfinite(slam.pose_cov).all()
    assert name != "rays" or slam.provisional == {5: 3} or len(slam.landmark_ids) == 1


@pytest.mark.parametrize("increment", [[1e308, 0.0, 0.0], [1e60, 0.0, 0.0]])
def test_huge_increments_are_refused(increment: list[float]):
    slam = driven("standard")
    before = pickle.dumps(slam.map.belief)
    with pytest.raises(UserError, match=r"^increment = .*: a number must be below 1e\+50[^\n]*$"):
        slam.predict(increment, np.eye(3))
    with pytest.raises(UserError, match=r"^increment"):
        slam.predict(np.zeros(3), 1e200 * np.eye(3))
    assert pickle.dumps(slam.map.belief) == before


def test_a_map_that_needs_too_much_memory_is_refused_and_unchanged(monkeypatch: pytest.MonkeyPatch):
    slam = driven("standard")
    before = believed(slam)
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 100_000.0)
    values = np.column_stack([np.full(200, 5.0), np.linspace(-3.0, 3.0, 200)])
    with pytest.raises(UserError, match=r"^the covariance of 203 landmarks or members of rays needs 0.0 GB of memory"):
        slam.update(scan([*range(200, 400)], values, NOISE[2]))
    assert_believes(slam, before)
