"""Proper scores of positions in metres (CRPS, energy score), PIT histogram, and the interval of a mean within one run.

Sources: Gneiting and Raftery (JASA 102, 2007) for the scores; Politis and Romano (JASA 89, 1994) for the stationary
bootstrap; Politis and White (Econometric Reviews 23, 2004), corrected by Patton, Politis and White (28, 2009), for the
length of its blocks.
"""

from __future__ import annotations

import math

import numpy as np

from slamgauge.arrays import Float, chunks
from slamgauge.compare.scoring.consistency import squared_mahalanobis
from slamgauge.compare.scoring.nan_stats import mean
from slamgauge.compare.scoring.trajectory_error import pose_errors, squared_distances
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

BINS = 10  # of the PIT histogram
DIRECTIONS = 32  # in half a turn, for the energy score: relative error below 1e-4 for axes up to 1:10, 0.2 % for a line
RESAMPLES = 400  # of the bootstrap
LEVEL = 0.95  # of its interval
SHORTEST = 8  # values of a series; shorter ones have no interval


def crps(errors: Float, sigmas: Float) -> Float:
    """Return the continuous ranked probability score of Gaussians, in the unit of `errors`; same shapes.

    It is the integral of (F(x) - 1[x >= truth])^2. A sigma of 0 gives the absolute error.
    """
    from scipy.special import ndtr  # here: scipy is slow to start

    z = np.divide(errors, sigmas, out=np.zeros_like(errors), where=sigmas > 0)
    density = np.exp(-0.5 * z**2) / math.sqrt(2 * math.pi)
    scores = errors * (2 * ndtr(z) - 1) + sigmas * (2 * density - 1 / math.sqrt(math.pi))
    return np.where(sigmas > 0, scores, np.where(sigmas == 0, np.abs(errors), np.nan))


def energy_scores(errors: Float, covs: Float) -> Float:
    """Return E|X - y| - E|X - X'| / 2 [m] of position `errors` (n, 2) under Gaussians with `covs` (n, 2, 2).

    The length of a plane vector is pi/2 times the mean over directions of its absolute projection, so the energy score
    is pi/2 times the mean CRPS of the projections.
    """
    angles = np.arange(DIRECTIONS) * (math.pi / DIRECTIONS)
    scores = np.zeros(len(errors))
    for rows in chunks(len(errors)):
        for u in np.column_stack([np.cos(angles), np.sin(angles)]):
            variances = covs[rows] @ u @ u
            scores[rows] += crps(errors[rows] @ u, np.sqrt(variances.clip(min=0)))
    return scores * (math.pi / 2 / DIRECTIONS)


def block_length(values: Float) -> float:
    """Return the mean length of blocks for the stationary bootstrap of a series (n,), from 1 to min(3 sqrt(n), n/3).

    It is (n (G/g)^2)^(1/3) with g the sum of the autocovariances R(k) and G that of |k| R(k), both tapered beyond the
    lag from which correlations are insignificant.
    """
    n = len(values)
    centred = values - values.mean()
    in_a_row = max(5, math.ceil(math.sqrt(math.log10(n))))
    lags = min(math.ceil(math.sqrt(n)) + in_a_row, n - 1)
    R = np.array([centred[: n - k] @ centred[k:] / n for k in range(lags + 1)])
    if not R[0] > 0:
        return 1.0
    significant = np.abs(R[1:]) >= 2 * math.sqrt(math.log10(n) / n) * R[0]
    quiet = (k for k in range(lags) if not significant[k : k + in_a_row].any())
    cut = min(2 * max(next(quiet, lags), 1), lags)
    k = np.arange(1, cut + 1)
    taper = np.minimum(1.0, 2 * (1 - k / cut))
    g = R[0] + 2 * (taper * R[1 : cut + 1]).sum()
    G = 2 * (taper * k * R[1 : cut + 1]).sum()
    if not g > 0:
        return 1.0
    return min(max((n * (G / g) ** 2) ** (1 / 3), 1.0), 3 * math.sqrt(n), n / 3)


def bootstrap_means(values: Float, length: float, seed: int = 0) -> Float:
    """Return the means (RESAMPLES,) of series made of blocks of `values` (n,) with geometric lengths of mean `length`.

    Blocks begin anywhere and continue at the beginning of the series after its end.
    """
    rng, n = np.random.default_rng(seed), len(values)
    sums = np.concatenate([[0.0], np.cumsum(np.tile(values, 2))])
    means = np.empty(RESAMPLES)
    for i in range(RESAMPLES):
        is_start = rng.random(n) < 1 / length
        is_start[0] = True
        lengths = np.diff(np.flatnonzero(np.append(is_start, True)))
        begin = rng.integers(0, n, len(lengths))
        means[i] = (sums[begin + lengths] - sums[begin]).sum() / n
    return means


def mean_within_run(values: Float) -> tuple[float, float] | None:
    """Return the interval of the mean of a correlated series (n,) with gaps (NaN); None below SHORTEST values.

    It only shows the variation within the run. Errors that last for the whole run do not show it: see docs/results.md.
    """
    values = values[np.isfinite(values)]
    if len(values) < SHORTEST:
        return None
    means = bootstrap_means(values, block_length(values))
    low, high = np.quantile(means, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


# --- for the catalogue ---------------------------------------------------------------------------


def mean_crps(truth: Truth, _recording: Recording, estimate: Estimate) -> float | None:
    """Return the mean over steps and over x and y of the CRPS [m]."""
    if truth.poses is None or estimate.pose_covs is None:
        return None
    errors = pose_errors(truth.poses, estimate.poses)[:, :2]
    variances = np.diagonal(estimate.pose_covs[:, :2, :2], axis1=1, axis2=2)
    scores = np.empty_like(errors)
    for rows in chunks(len(errors)):
        scores[rows] = crps(errors[rows], np.sqrt(variances[rows].clip(min=0)))
    return mean(scores.ravel())


def mean_energy_score(truth: Truth, _recording: Recording, estimate: Estimate) -> float | None:
    """Return the mean over steps of the energy score of the position [m]."""
    if truth.poses is None or estimate.pose_covs is None:
        return None
    errors = pose_errors(truth.poses, estimate.poses)[:, :2]
    return mean(energy_scores(errors, estimate.pose_covs[:, :2, :2]))


def pit_histogram(truth: Truth, _recording: Recording, estimate: Estimate) -> list[float] | None:
    """Return the share of the steps in each of BINS bins of the probability of the ellipse through the true position.

    All are equal if the covariance is right; an overconfident estimate has too many in the last bin.
    """
    if truth.poses is None or estimate.pose_covs is None:
        return None
    errors = pose_errors(truth.poses, estimate.poses)[:, :2]
    nees = squared_mahalanobis(errors, estimate.pose_covs[:, :2, :2])
    probability = -np.expm1(-nees[~np.isnan(nees)] / 2)  # chi-square with two degrees of freedom is exponential
    if not len(probability):
        return None
    counts = np.histogram(probability, BINS, (0.0, 1.0))[0]
    return [float(each) for each in counts / len(probability)]


def ate_interval(truth: Truth, _recording: Recording, estimate: Estimate) -> list[float] | None:
    """Return the ends of the bootstrap interval of the ATE within the run [m]."""
    if truth.poses is None:
        return None
    ends = mean_within_run(squared_distances(pose_errors(truth.poses, estimate.poses)))
    return None if ends is None else [math.sqrt(max(each, 0.0)) for each in ends]
