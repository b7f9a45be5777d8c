"""Invalid arguments of online filters are refused in one line with place, value and remedy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from slamgauge.ekf import AssociatingFilter, Association, BearingFilter, SlamFilter, estimators
from slamgauge.ekf.maps.correction_table import CORRECTIONS, RULES
from slamgauge.errors import UserError

MEAN, COV = np.array([0.1, 0.2, 0.3]), 1e-4 * np.eye(3)
EVERY: tuple[Any, ...] = (
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
    *((EVERY, (mean, cov), {}, match) for mean, cov, match in PRIORS),
    *((EVERY, (MEAN, COV), {"correction": x}, f"correction: '{x}' is not known; {remedy}") for x, remedy in CORRECTION),
    *((NAMED, (x, MEAN, COV), {}, SENSOR) for x in (None, ["position"], np.array(["position"] * 2), "sonar")),
    *((EVERY[:1], (MEAN, COV), {"landmarks": x}, NOT_A_NUMBER) for x in (-1, 1.5, 3.0, "3", None, True, [3])),
    (NAMED[1:], ("bearing", MEAN, COV), {}, "sensor: 'bearing' does not fit this filter; use one of .*, position"),
    (
        EVERY[1:2],
        (MEAN, COV),
        {"association": "jcbb"},
        r"association: 'jcbb' is not an Association; give Association.*",
    ),
    (EVERY, (MEAN, COV), {"robust": "gate"}, r"robust: 'gate' is not a Robustness; give Robustness\('gate'\).*"),
    ((Association,), ("jcb",), {}, r"method: 'jcb' is not known; did you mean jcbb\?"),
]


@pytest.mark.parametrize(("makers", "arguments", "more", "match"), REFUSED)
def test_invalid_arguments(
    makers: tuple[Any, ...], arguments: tuple[Any, ...], more: dict[str, Any], match: str
) -> None:
    for make in makers:
        with pytest.raises(UserError, match=f"^{match}$"):
            make(*arguments, **more)


def test_every_correction_is_an_estimator() -> None:
    assert {*CORRECTIONS.values()} == {*RULES}
    for name in CORRECTIONS:
        assert callable(getattr(estimators, "ekf_slam" if name == "ekf" else name.replace("-", "_")))
