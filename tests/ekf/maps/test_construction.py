"""Invalid arguments of online filters are refused in one line with place, value and remedy."""

from __future__ import annotations

import numpy as np
import pytest

from slamgauge.ekf import AssociatingFilter, Association, BearingFilter, SlamFilter
from slamgauge.ekf.maps.correction_table import CORRECTIONS, RULES
from slamgauge.errors import UserError

START = (np.array([0.1, 0.2, 0.3]), 1e-4 * np.eye(3))


@pytest.mark.parametrize(
    ("mean", "cov", "match"),
    [
        ([0.0, 0.0], np.eye(3), r"^prior_mean: shape \(2,\) does not fit; give shape \(3,\)$"),
        ([0.0, np.inf, 0.0], np.eye(3), r"^prior_mean\[1\] = inf: every number must be finite$"),
        (np.zeros(3), [0.1, 0.2, 0.3], r"^prior_cov: shape \(3,\) does not fit; give shape \(3, 3\)$"),
        (np.zeros(3), -np.eye(3), r"^prior_cov\[0\] = .*: a covariance must not have a negative variance$"),
        (["a", "b", "c"], np.eye(3), r"^prior_mean: not an array of numbers; give shape \(3,\)$"),
        (["1", "2", "3"], np.eye(3), r"^prior_mean: not an array of numbers; give shape \(3,\)$"),
        (np.zeros(3) * 1j, np.eye(3), r"^prior_mean: not an array of numbers; give shape \(3,\)$"),
        (None, np.eye(3), r"^prior_mean: shape \(\) does not fit; give shape \(3,\)$"),
        (np.zeros(3), "large", r"^prior_cov: not an array of numbers; give shape \(3, 3\)$"),
        (np.zeros(3), [[1.0], [0.0, 1.0]], r"^prior_cov: not an array of numbers; give shape \(3, 3\)$"),
    ],
)
def test_invalid_priors(mean: object, cov: object, match: str) -> None:
    for make in (
        lambda: SlamFilter("position", mean, cov),  # pyrefly: ignore[bad-argument-type]
        lambda: AssociatingFilter("position", mean, cov),  # pyrefly: ignore[bad-argument-type]
        lambda: BearingFilter(mean, cov),  # pyrefly: ignore[bad-argument-type]
    ):
        with pytest.raises(UserError, match=match):
            make()


@pytest.mark.parametrize("landmarks", [-1, 1.5, 3.0, "3", None, True, [3]], ids=str)
def test_invalid_numbers_of_landmarks(landmarks: object) -> None:
    refusal = r"^landmarks: \S+ is not a number of landmarks; give a whole number, at least 0$"
    with pytest.raises(UserError, match=refusal):
        SlamFilter("position", *START, landmarks=landmarks)  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize("sensor", [None, ["position"], np.array(["position", "position"]), "sonar"], ids=str)
def test_invalid_sensors(sensor: object) -> None:
    for make in (
        lambda: SlamFilter(sensor, *START),  # pyrefly: ignore[bad-argument-type]
        lambda: AssociatingFilter(sensor, *START),  # pyrefly: ignore[bad-argument-type]
    ):
        with pytest.raises(UserError, match=r"^sensor: .* does not fit this filter; use one of range-bearing, [^\n]*$"):
            make()


def test_invalid_associations() -> None:
    with pytest.raises(UserError, match=r"^association: 'jcbb' is not an Association; give Association\("):
        AssociatingFilter("position", *START, association="jcbb")  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("riekf", r"the estimator of that name uses 'right-invariant'"),
        ("oc-ekf", r"the estimator of that name uses 'observability-constrained'"),
        ("right-invarient", r"did you mean right-invariant\?"),
        ("ukf", r"use one of standard, .*right-invariant"),
    ],
)
def test_unknown_corrections(name: str, remedy: str) -> None:
    for make in (
        lambda: SlamFilter("position", *START, name),  # pyrefly: ignore[bad-argument-type]
        lambda: AssociatingFilter("position", *START, name),  # pyrefly: ignore[bad-argument-type]
        lambda: BearingFilter(*START, name),  # pyrefly: ignore[bad-argument-type]
    ):
        with pytest.raises(ValueError, match=rf"^correction: '{name}' is not known; {remedy}$"):
            make()


def test_every_correction_is_an_estimator() -> None:
    from slamgauge.ekf import estimators

    assert {*CORRECTIONS.values()} == {*RULES}
    for name in CORRECTIONS:
        assert callable(getattr(estimators, "ekf_slam" if name == "ekf" else name.replace("-", "_")))


def test_other_unknown_names() -> None:
    with pytest.raises(ValueError, match=r"^method: 'jcb' is not known; did you mean jcbb\?$"):
        Association("jcb")  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(
        ValueError, match=r"^sensor: 'bearing' does not fit this filter; use one of range-bearing, position$"
    ):
        AssociatingFilter("bearing", *START)
