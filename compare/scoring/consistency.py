"""Errors of a path relative to a reference, without alignment, and whether they are as large as covariances say.

Rows of the reference that are NaN give NaN.
"""

from __future__ import annotations

import math

import numpy as np

from slamgauge.arrays import Float, chunks
from slamgauge.errors import UserError
from slamgauge.se2 import between, wrap

SINGULAR = 1e-9  # largest smallest eigenvalue of a correlation matrix that may be rounding (as in `validation`)
FARTHEST = 1e100  # limit of distances, so that sums of their squares are finite, as result files require


def pose_errors(reference: Float, poses: Float) -> Float:
    """Return additive errors (n, 3) of `poses` (n, 3) in the world frame, [m, m, rad], heading wrapped."""
    errors = poses - reference
    errors[:, 2] = wrap(errors[:, 2])
    return errors


def distances(errors: Float) -> Float:
    """Return position errors (n,) [m] of additive errors (n, 2 or 3)."""
    return np.sqrt(np.square(errors[:, :2]).sum(axis=1))


def step_errors(reference: Float, poses: Float) -> Float:
    """Return translations (n-1,) [m] by which consecutive body-frame steps differ (evo's RPE at a delta of one)."""
    errors = np.empty(len(poses) - 1)
    for rows in chunks(len(errors)):
        after = slice(rows.start + 1, rows.stop + 1)
        errors[rows] = distances(between(poses[rows], poses[after]) - between(reference[rows], reference[after]))
    return errors


def squared_mahalanobis(errors: Float, covs: Float) -> Float:
    """Return e' P^-1 e (n,) of `errors` (n, d) under `covs` (n, d, d); for estimation errors this is the NEES.

    NaN where the covariance is singular (a fixed start, P0 = 0) or either is NaN. Variances may have different units:
    the correlation matrix is checked and solved, not the covariance.
    """
    found = np.full(len(errors), np.nan)
    for part in chunks(len(errors)):
        e, P = errors[part], covs[part]
        sigmas = np.sqrt(np.diagonal(P, axis1=1, axis2=2).clip(min=0))
        rows = np.flatnonzero(np.isfinite(e).all(axis=1) & np.isfinite(P).all(axis=(1, 2)) & (sigmas > 0).all(axis=1))
        C = P[rows] / (sigmas[rows, :, None] * sigmas[rows, None, :])
        regular = np.linalg.eigvalsh(C)[:, 0] > SINGULAR
        rows, C = rows[regular], C[regular]
        scaled = e[rows] / sigmas[rows]
        solved = np.linalg.solve(C, scaled[:, :, None])[:, :, 0]
        with np.errstate(over="ignore"):
            found[part.start + rows] = np.minimum((scaled * solved).sum(axis=1), FARTHEST)
    return found


def chi2_band(level: float, dof: float) -> tuple[float, float]:
    """Return the two-sided interval that contains a chi-square variable of `dof` with probability `level`."""
    from scipy.special import gammainccinv, gammaincinv  # here: scipy is slow to start

    if not 0 < level < 1:
        raise UserError(f"level = {level}: not a probability inside (0, 1); use 0.95, for instance")
    tail = (1 - level) / 2
    return 2 * float(gammaincinv(dof / 2, tail)), 2 * float(gammainccinv(dof / 2, tail))


def is_inside(nees_position: Float, level: float) -> Float:
    """Return 1 where the true position is inside the ellipse of probability `level`, else 0; NaN where undefined.

    Chi-square with two degrees of freedom is exponential: the ellipse is e' P^-1 e <= -2 log(1 - level).
    """
    return np.where(np.isnan(nees_position), np.nan, nees_position <= -2 * math.log1p(-level))
