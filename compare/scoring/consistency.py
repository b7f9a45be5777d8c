"""Whether an error is as large as its covariance says: squared Mahalanobis distances and their bounds."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, chunks
from slamgauge.errors import UserError

SINGULAR = 1e-9  # smallest eigenvalue of a correlation matrix that is more than rounding (as in `slamgauge.validation`)
LARGEST = 1e100  # of a distance: sums of squares of them are numbers still, as files of results need


def squared_mahalanobis(errors: Float, covs: Float) -> Float:
    """Distances e' P^-1 e (n,) of `errors` (n, d) under `covs` (n, d, d): the NEES, for estimation errors.

    NaN where the covariance is singular (a fixed start, P0 = 0) or either is NaN. Variances may have
    different units: the correlation matrix is judged and solved, not the covariance.
    """
    distances = np.empty(len(errors))
    for rows in chunks(len(errors)):
        distances[rows] = _distances(errors[rows], covs[rows])
    return distances


def _distances(errors: Float, covs: Float) -> Float:
    sigmas = np.sqrt(np.diagonal(covs, axis1=1, axis2=2).clip(min=0))
    defined = np.isfinite(errors).all(axis=1) & np.isfinite(covs).all(axis=(1, 2)) & (sigmas > 0).all(axis=1)
    correlations = covs[defined] / (sigmas[defined, :, None] * sigmas[defined, None, :])
    found, determinant = _eliminate(correlations.copy(), errors[defined] / sigmas[defined])
    # no eigenvalue exceeds d, so the smallest is at least the determinant over d^(d-1): few need a closer look
    size = errors.shape[1]
    regular = determinant > SINGULAR * size ** (size - 1)
    doubtful = ~regular
    regular[doubtful] = np.linalg.eigvalsh(correlations[doubtful])[:, 0] > SINGULAR
    distances = np.full(len(errors), np.nan)
    distances[np.flatnonzero(defined)[regular]] = np.minimum(found[regular], LARGEST)
    return distances


def _eliminate(C: Float, e: Float) -> tuple[Float, Float]:
    """Forms e' C^-1 e and determinants of C (n,) by Gaussian elimination without pivoting; overwrites both."""
    total, determinant = np.zeros(len(e)), np.ones(len(e))
    with np.errstate(all="ignore"):  # of singular matrices, which the caller leaves out
        for i in range(e.shape[1]):
            pivot = C[:, i, i]
            total += e[:, i] ** 2 / pivot
            determinant *= np.maximum(pivot, 0.0)  # an indefinite matrix is no covariance
            factor = C[:, i + 1 :, i] / pivot[:, None]
            e[:, i + 1 :] -= factor * e[:, i, None]
            C[:, i + 1 :, i + 1 :] -= factor[:, :, None] * C[:, None, i, i + 1 :]
    return total, determinant


def sigma_ratios(covs: Float, optimum_covs: Float) -> Float:
    """Ratios (n, d) of standard deviations, filter over optimum; NaN unless both are positive."""
    variances, optimal = (np.diagonal(stack, axis1=1, axis2=2) for stack in (covs, optimum_covs))
    both = (variances > 0) & (optimal > 0)
    return np.sqrt(np.divide(variances, optimal, out=np.full(variances.shape, np.nan), where=both))


def chi2_band(level: float, dof: float) -> tuple[float, float]:
    """Two-sided interval (low, high) that holds a chi-square variable of `dof` with probability `level`."""
    from scipy.special import gammainccinv, gammaincinv  # here: scipy is slow to start

    if not 0 < level < 1:
        raise UserError(f"level = {level}: not a probability inside (0, 1); use 0.95, for instance")
    if not dof > 0:
        raise UserError(f"dof = {dof}: chi-square needs positive degrees of freedom; give runs that have measurements")
    tail = (1 - level) / 2
    return 2 * float(gammaincinv(dof / 2, tail)), 2 * float(gammainccinv(dof / 2, tail))
