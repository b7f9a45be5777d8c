import math

import numpy as np
import pytest

from slamgauge.compare.scoring.consistency import LARGEST, SINGULAR, chi2_band, sigma_ratios, squared_mahalanobis


def test_squared_mahalanobis_agrees_with_the_inverse_whatever_the_units() -> None:
    rng = np.random.default_rng(0)
    A = rng.normal(size=(50, 3, 3)) * [[1e4], [1.0], [1e-6]]
    covs = A @ A.swapaxes(1, 2)
    errors = np.einsum("nij,nj->ni", A, rng.normal(size=(50, 3)))
    units = np.array([1e-4, 1.0, 1e6])
    scaled = covs * units[:, None] * units
    expected = [e @ np.linalg.inv(P) @ e for e, P in zip(errors * units, scaled, strict=True)]
    assert squared_mahalanobis(errors, covs) == pytest.approx(expected, rel=1e-6)


def test_a_singular_covariance_has_no_distance() -> None:
    covs = np.array([np.diag([1, 1, 0.0]), [[1, 1, 0], [1, 1, 0], [0, 0, 1]], np.eye(3), np.full((3, 3), np.nan)])
    assert squared_mahalanobis(np.ones((4, 3)), covs) == pytest.approx([np.nan, np.nan, 3, np.nan], nan_ok=True)


def test_a_covariance_that_is_all_but_zero_has_a_vast_distance_and_not_an_infinite_one() -> None:
    distances = squared_mahalanobis(np.full((2, 3), 1e9), np.array([np.eye(3) * 1e-307, np.eye(3)]))
    assert distances == pytest.approx([LARGEST, 3e18])


def test_sigma_ratios_need_both_sigmas() -> None:
    covs, optimum = np.array([np.diag([4.0, 0, 1])]), np.array([np.diag([1.0, 1, 0])])
    assert sigma_ratios(covs, optimum)[0] == pytest.approx([2, np.nan, np.nan], nan_ok=True)


@pytest.mark.parametrize(("runs", "low", "high"), [(20, 2.02, 4.17), (50, 2.36, 3.72), (100, 2.54, 3.50)])
def test_chi2_band_gives_the_literatures_nees_bounds(runs: int, low: float, high: float) -> None:
    band = chi2_band(0.95, 3 * runs)
    assert (band[0] / runs, band[1] / runs) == pytest.approx((low, high), abs=0.006)


@pytest.mark.parametrize("arguments", [(0.0, 3), (1.0, 3), (95, 3), (0.95, 0), (0.95, math.nan)])
def test_chi2_band_refuses_what_is_no_probability_or_no_dof(arguments: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match=r"^(level|dof) = "):
        chi2_band(*arguments)


def test_nees_of_right_covariances_falls_into_its_band_as_often_as_promised() -> None:
    """Coverage of 2000 draws at 90 %: binomial, two-sided false-alarm rate 0.1 % (3.29 sigma)."""
    rng = np.random.default_rng(1)
    A = rng.normal(size=(2000, 3, 3)) * [[1.0], [0.3], [0.02]]
    covs = A @ A.swapaxes(1, 2)
    nees = squared_mahalanobis(np.einsum("nij,nj->ni", A, rng.normal(size=(2000, 3))), covs)
    low, high = chi2_band(0.9, 3)
    share = np.mean((nees >= low) & (nees <= high))
    assert abs(share - 0.9) <= 3.29 * math.sqrt(0.9 * 0.1 / 2000)


def test_what_is_singular_is_told_by_the_smallest_eigenvalue_alone() -> None:
    """Correlations from independent to nearly certain, on both sides of the limit."""
    rng = np.random.default_rng(0)
    smallest = 10.0 ** rng.uniform(-12, 0, 500)
    axes = np.linalg.qr(rng.normal(size=(500, 3, 3)))[0]
    values = np.stack([smallest, rng.uniform(0.5, 1.5, 500), rng.uniform(0.5, 1.5, 500)], axis=1)
    covs = axes * values[:, None, :] @ axes.swapaxes(1, 2)
    covs = (covs + covs.swapaxes(1, 2)) / 2
    sigmas = np.sqrt(np.diagonal(covs, axis1=1, axis2=2))
    eigenvalue = np.linalg.eigvalsh(covs / (sigmas[:, :, None] * sigmas[:, None, :]))[:, 0]
    assert 50 < (eigenvalue < SINGULAR).sum() < 450
    np.testing.assert_array_equal(np.isnan(squared_mahalanobis(np.ones((500, 3)), covs)), eigenvalue <= SINGULAR)
