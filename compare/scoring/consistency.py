"""Whether errors are as large as the covariance says: Mahalanobis distances, chi-square bands, coverage of ellipses."""

from __future__ import annotations

import math

import numpy as np

from slamgauge.arrays import Float, chunks
from slamgauge.errors import UserError

SINGULAR = 1e-9  # largest smallest eigenvalue of a correlation matrix that may be rounding (as in `validation`)
FARTHEST = 1e100  # limit of distances, so that sums of their squares are finite, as result files require


def squared_mahalanobis(errors: Float, covs: Float) -> Float:
    """Return e' P^-1 e (n,) of `errors` (n, d) under `covs` (n, d, d); for estimation errors this is the NEES.

    NaN where the covariance is singular (a fixed start, P0 = 0) or either is NaN. Variances may have different units:
    the correlation matrix is checked and solved, not the covariance.
    """
    values = np.empty(len(errors))
    for rows in chunks(len(errors)):
        values[rows] = _distances(errors[rows], covs[rows])
    return values


def _distances(errors: Float, covs: Float) -> Float:
    sigmas = np.sqrt(np.diagonal(covs, axis1=1, axis2=2).clip(min=0))
    defined = np.isfinite(errors).all(axis=1) & np.isfinite(covs).all(axis=(1, 2)) & (sigmas > 0).all(axis=1)
    correlations = covs[defined] / (sigmas[defined, :, None] * sigmas[defined, None, :])
    found, determinant = _eliminate(correlations.copy(), errors[defined] / sigmas[defined])
    # no eigenvalue exceeds d, so the smallest is at least the determinant over d^(d-1): few are computed
    size = errors.shape[1]
    regular = determinant > SINGULAR * size ** (size - 1)
    doubtful = ~regular
    regular[doubtful] = np.linalg.eigvalsh(correlations[doubtful])[:, 0] > SINGULAR
    distances = np.full(len(errors), np.nan)
    distances[np.flatnonzero(defined)[regular]] = np.minimum(found[regular], FARTHEST)
    return distances


def _eliminate(C: Float, e: Float) -> tuple[Float, Float]:
    """Return e' C^-1 e and determinants of C (n,) by Gaussian elimination without pivoting; overwrites both."""
    total, determinant = np.zeros(len(e)), np.ones(len(e))
    with np.errstate(all="ignore"):  # the caller leaves singular matrices out
        for i in range(e.shape[1]):
            pivot = C[:, i, i]
            total += e[:, i] ** 2 / pivot
            determinant *= np.maximum(pivot, 0.0)  # 0 for an indefinite matrix
            factor = C[:, i + 1 :, i] / pivot[:, None]
            e[:, i + 1 :] -= factor * e[:, i, None]
            C[:, i + 1 :, i + 1 :] -= factor[:, :, None] * C[:, None, i, i + 1 :]
    return total, determinant


def chi2_band(level: float, dof: float) -> tuple[float, float]:
    """Return the two-sided interval that contains a chi-square variable of `dof` with probability `level`.

    Raises:
        UserError: level or dof are out of range.
    """
    from scipy.special import gammainccinv, gammaincinv  # here: scipy is slow to start

    if not 0 < level < 1:
        raise UserError(f"level = {level}: not a probability inside (0, 1); use 0.95, for instance")
    if not dof > 0:
        raise UserError(f"dof = {dof}: chi-square needs positive degrees of freedom; give runs that have measurements")
    tail = (1 - level) / 2
    return 2 * float(gammaincinv(dof / 2, tail)), 2 * float(gammainccinv(dof / 2, tail))


def is_inside(nees_position: Float, level: float) -> Float:
    """Return 1 where the true position is inside the ellipse of probability `level`, else 0; NaN where undefined.

    Chi-square with two degrees of freedom is exponential: the ellipse is e' P^-1 e <= -2 log(1 - level).
    """
    return np.where(np.isnan(nees_position), np.nan, nees_position <= -2 * math.log1p(-level))
