"""Covariances seen as correlations: units differ, so each entry is judged by its own standard deviations."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float


def scale_of(covs: Float) -> Float:
    """What makes correlations of covariances (n, d, d) when they are divided by it; 1 for what has no variance."""
    variances = np.diagonal(covs, axis1=1, axis2=2)
    sigmas = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    return sigmas[:, :, None] * sigmas[:, None, :]


def without_negative_eigenvalues(covs: Float) -> Float:
    """Covariances (n, d, d) whose correlations have no eigenvalue below zero, exactly symmetric.

    Rounding leaves such eigenvalues where a covariance is singular.
    """
    scale = scale_of(covs)
    correlations = covs / scale
    values, axes = np.linalg.eigh((correlations + correlations.swapaxes(1, 2)) / 2)
    whole = (axes * values.clip(min=0.0)[:, None, :]) @ axes.swapaxes(1, 2) * scale
    return (whole + whole.swapaxes(1, 2)) / 2


def inverted(matrices: Float) -> Float:
    """Inverses of positive definite matrices (n, d, d), exactly symmetric; their units may differ widely."""
    scale = scale_of(matrices)
    with np.errstate(over="ignore"):  # what is not finite is found by whoever takes it
        inverse = np.linalg.inv(matrices / scale) / scale
    return (inverse + inverse.swapaxes(1, 2)) / 2


def square_roots(covs: Float) -> Float:
    """Symmetric square roots (n, d, d) of covariances (n, d, d), singular ones too."""
    values, vectors = np.linalg.eigh(covs)
    return (vectors * np.sqrt(values.clip(min=0.0))[:, None, :]) @ vectors.swapaxes(1, 2)
