"""Quality of an optimum (is it the optimum, does its model fit, what does it leave out), and figures relative to it."""

from __future__ import annotations

import math

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.scoring.consistency import chi2_band, squared_mahalanobis
from slamgauge.compare.scoring.intervals import ROUNDING, Interval
from slamgauge.compare.scoring.measured import Measured, pose_covs_of
from slamgauge.compare.scoring.nan_stats import mean, number, rms
from slamgauge.compare.scoring.trajectory_error import distances, pose_errors
from slamgauge.estimate import Estimate
from slamgauge.truth import NOBODY, Truth

MISFIT_LEVEL = 0.999  # probability of the two-sided chi-square band outside of which residuals are implausible
MISFIT = 0.05  # least deviation of chi2/dof from 1 that causes a warning
CHECK_LIMIT = 0.05  # sigmas: a causal optimum that is farther from the hindsight optimum at the end is in doubt


def is_in_doubt(check: float | None) -> bool:
    """Return whether an optimum was checked and is too far from the hindsight optimum."""
    return check is not None and check > CHECK_LIMIT


def is_misfit(optimum: Estimate) -> bool:
    """Return whether the residuals of an optimum deviate significantly, and by more than MISFIT, from its noise."""
    if optimum.chi_square is None or not optimum.chi_square_dof:
        return False
    low, high = chi2_band(MISFIT_LEVEL, optimum.chi_square_dof)
    return not low <= optimum.chi_square <= high and abs(optimum.chi_square / optimum.chi_square_dof - 1.0) > MISFIT


def is_misfit_in_runs(fit: Interval | None) -> bool:
    """Return the same for the mean chi2/dof of many runs with its 95 % interval."""
    if fit is None or fit.low is None or fit.high is None:
        return False
    return fit.low > 1.0 + MISFIT or fit.high < 1.0 - MISFIT


def share_of_doubt(checks: Float) -> float | None:
    """Return the share of the checked runs (R,) whose optimum is in doubt; NaN is not checked."""
    return mean(np.where(np.isnan(checks), np.nan, checks > CHECK_LIMIT))


def unused_observations(truth: Truth, optimum: Estimate) -> int | None:
    """Return the number of observations that an optimum does not use, except outliers and clutter; None: unknown."""
    if optimum.association is None:
        return None
    unused = optimum.association == NOBODY
    return int(np.sum(unused if truth.misleading is None else unused & ~truth.misleading))


# --- for the catalogue ---------------------------------------------------------------------------


def chi_square_per_dof(estimate: Estimate) -> float | None:
    """Return chi2/dof of an optimum; None without a degree of freedom."""
    if estimate.chi_square is None or not estimate.chi_square_dof:
        return None
    return estimate.chi_square / estimate.chi_square_dof


def ratio_to_optimum(found: Measured) -> float | None:
    """Return the ATE over that of the optimum; None if the latter is not above ROUNDING."""
    if found.optimum is None:
        return None
    ate, best = rms(found.off), rms(distances(pose_errors(found.reference, found.optimum.poses)))
    return ate / best if ate is not None and best is not None and best > ROUNDING else None


def mahalanobis_to_optimum(found: Measured) -> float | None:
    """Return the mean squared Mahalanobis distance of the poses to those of the optimum, under its covariance."""
    if found.optimum is None:
        return None
    differences = pose_errors(found.optimum.poses, found.estimate.poses)
    squares = squared_mahalanobis(differences, pose_covs_of(found.optimum))
    return mean(squares if found.compared is None else squares[found.compared])


def final_distance_to_batch(found: Measured) -> float | None:
    """Return the distance of the last position from that of the hindsight optimum [m]."""
    if found.batch is None:
        return None
    return number(math.dist(found.estimate.poses[found.last, :2], found.batch.poses[found.last, :2]))
