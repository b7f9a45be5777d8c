"""Operations on covariances, scaled to correlations because units differ."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float


def scale_of(covs: Float) -> Float:
    """Return the products of standard deviations (n, d, d), by which covariances divide into correlations.

    An entry without variance counts as variance 1.
    """
    variances = np.diagonal(covs, axis1=1, axis2=2)
    sigmas = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    return sigmas[:, :, None] * sigmas[:, None, :]


def without_negative_eigenvalues(covs: Float) -> Float:
    """Return the covariances (n, d, d), exactly symmetric, with negative eigenvalues of correlations set to zero.

    Rounding leaves such eigenvalues where a covariance is singular.
    """
    scale = scale_of(covs)
    correlations = covs / scale
    values, axes = np.linalg.eigh((correlations + correlations.swapaxes(1, 2)) / 2)
    whole = (axes * values.clip(min=0.0)[:, None, :]) @ axes.swapaxes(1, 2) * scale
    return (whole + whole.swapaxes(1, 2)) / 2


def inverted(matrices: Float) -> Float:
    """Return inverses of positive definite matrices (n, d, d), exactly symmetric; units may differ widely."""
    scale = scale_of(matrices)
    with np.errstate(over="ignore"):  # the caller checks for infinite entries
        inverse = np.linalg.inv(matrices / scale) / scale
    return (inverse + inverse.swapaxes(1, 2)) / 2


def square_roots(covs: Float) -> Float:
    """Return symmetric square roots (n, d, d) of covariances (n, d, d), which may be singular."""
    values, vectors = np.linalg.eigh(covs)
    return (vectors * np.sqrt(values.clip(min=0.0))[:, None, :]) @ vectors.swapaxes(1, 2)
