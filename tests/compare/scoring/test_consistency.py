"""Mahalanobis distances and coverage against closed forms and chi-square."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from slamgauge.compare.scoring.catalogue import STORED
from slamgauge.compare.scoring.consistency import FARTHEST, SINGULAR, chi2_band, is_inside, squared_mahalanobis
from slamgauge.compare.scoring.runs import FIRST_STEP, SERIES, Runs
from slamgauge.compare.scoring.scores import evaluate
from slamgauge.compare.studies.summary import summarise
from slamgauge.estimate import Estimate
from slamgauge.truth import Truth

from .builders import straight

STEPS = 20_000
COV = np.array([[0.04, 0.01, 0.002], [0.01, 0.09, -0.003], [0.002, -0.003, 0.0025]])


def test_distance_agrees_with_the_inverse_in_any_units() -> None:
    rng = np.random.default_rng(0)
    A = rng.normal(size=(50, 3, 3)) * [[1e4], [1.0], [1e-6]]
    errors, covs = np.einsum("nij,nj->ni", A, rng.normal(size=(50, 3))), A @ A.swapaxes(1, 2)
    units = np.array([1e-4, 1.0, 1e6])
    pairs = [*zip(errors * units, covs * units[:, None] * units, strict=True)]
    assert squared_mahalanobis(errors, covs) == pytest.approx([e @ np.linalg.inv(P) @ e for e, P in pairs], rel=1e-6)


def test_a_singular_covariance_has_no_distance_and_distances_are_limited() -> None:
    nearly = [[1, 1 - SINGULAR / 2, 0], [1 - SINGULAR / 2, 1, 0], [0, 0, 1]]  # an eigenvalue of half the limit
    covs = np.array([np.diag([1, 1, 0.0]), nearly, np.eye(3), np.full((3, 3), np.nan), np.diag([1e-12, 1, 1e6])])
    found = squared_mahalanobis(np.ones((5, 3)), covs)
    assert found == pytest.approx([np.nan, np.nan, 3, np.nan, 1e12 + 1], nan_ok=True)
    assert squared_mahalanobis(np.full((1, 3), 1e9), np.eye(3)[None] * 1e-307) == FARTHEST


@pytest.mark.parametrize(("runs", "low", "high"), [(20, 2.02, 4.17), (50, 2.36, 3.72), (100, 2.54, 3.50)])
def test_the_chi_square_band_equals_published_nees_bounds(runs: int, low: float, high: float) -> None:
    band = chi2_band(0.95, 3 * runs)
    assert (band[0] / runs, band[1] / runs) == pytest.approx((low, high), abs=0.006)


@pytest.mark.parametrize("factor", [1.0, 0.5, 2.0])
def test_coverage_has_its_expected_value(factor: float) -> None:
    """Sigmas that are `factor` times too large: coverage 1 - (1 - level)^factor^2, two-sided 0.999 binomial bounds."""
    errors = np.random.default_rng(7).multivariate_normal(np.zeros(3), COV, STEPS + 1)
    estimate = Estimate(kind="filtered", poses=errors, pose_covs=np.tile(factor**2 * COV, (STEPS + 1, 1, 1)))
    truth = Truth(poses=np.zeros((STEPS + 1, 3)))
    low, high = stats.binom.interval(0.999, STEPS + 1, 1 - (1 - 0.95) ** (factor**2))
    assert low <= evaluate(truth, straight(STEPS), estimate)["coverage_95"] * (STEPS + 1) <= high
    assert evaluate(None, straight(STEPS), estimate)["coverage_95"] is None


def test_studies_have_the_coverage_of_the_late_steps() -> None:
    assert is_inside(np.array([0.1, 5.9, 6.0, np.nan]), 0.95) == pytest.approx([1, 1, 0, np.nan], nan_ok=True)
    nees = np.zeros((2, FIRST_STEP + 4))
    nees[:, :FIRST_STEP] = 1e9  # early steps do not count
    nees[0, FIRST_STEP] = 7.0
    series = dict.fromkeys(SERIES, np.full(nees.shape, np.nan)) | {"nees_position": nees}
    runs = Runs(np.arange(2), "filtered", {key: np.full(2, np.nan) for key in STORED}, series)
    assert summarise({"ekf": runs})["ekf"].to_json()["coverage_95"]["mean"] == pytest.approx((3 / 4 + 1) / 2)


def test_the_mean_nees_of_a_step_has_the_band_of_the_runs_that_have_one() -> None:
    series = {"nees_pose": np.array([[np.nan, 2.0], [np.nan, 4.0], [np.nan, np.nan]])}
    value, low, high = Runs(np.arange(3), "filtered", {}, series).nees_per_step()
    assert value == pytest.approx([np.nan, 3.0], nan_ok=True)
    assert [low[1], high[1]] == pytest.approx(np.divide(chi2_band(0.999, 6), 2))
