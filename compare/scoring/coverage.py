"""Whether the Gaussian of an estimate is to be believed: how often its ellipses hold the truth, and its log score."""

from __future__ import annotations

import math

import numpy as np

from slamgauge.arrays import Float, chunks
from slamgauge.compare.scoring.consistency import squared_mahalanobis
from slamgauge.compare.scoring.nan_stats import mean
from slamgauge.compare.scoring.trajectory_error import pose_errors
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth


def is_inside(nees_position: Float, level: float) -> Float:
    """1 where a true position lies in the ellipse that claims to hold it with probability `level`, else 0; NaN stays.

    Chi-square with two degrees of freedom is exponential: the ellipse is where e' P^-1 e <= -2 log(1 - level).
    """
    return np.where(np.isnan(nees_position), np.nan, nees_position <= -2 * math.log1p(-level))


def log_scores(errors: Float, covs: Float) -> Float:
    """-log p (n,) [nats] of the truth, under Gaussians with additive `errors` (n, d) and `covs` (n, d, d).

    NaN where the covariance is singular. A proper score (Good 1952): in the mean no sigmas have a smaller one than the
    right ones. The units of the errors, metres and radians here, are in it, so that only differences say something.
    """
    scores = np.empty(len(errors))
    for rows in chunks(len(errors)):
        scores[rows] = _log_scores(errors[rows], covs[rows])
    return scores


def _log_scores(errors: Float, covs: Float) -> Float:
    nees = squared_mahalanobis(errors, covs)
    scores = np.full(len(errors), np.nan)
    regular = ~np.isnan(nees)
    sigmas = np.sqrt(np.diagonal(covs[regular], axis1=1, axis2=2))
    correlations = covs[regular] / (sigmas[:, :, None] * sigmas[:, None, :])
    log_det = np.linalg.slogdet(correlations)[1] + 2 * np.log(sigmas).sum(axis=1)
    scores[regular] = (nees[regular] + log_det + errors.shape[1] * math.log(2 * math.pi)) / 2
    return scores


# --- what the catalogue names --------------------------------------------------------------------


def coverage_50(truth: Truth, _recording: Recording, estimate: Estimate) -> float | None:
    """Share of the positions inside their 50 % ellipses."""
    return _coverage(truth, estimate, 0.5)


def coverage_95(truth: Truth, _recording: Recording, estimate: Estimate) -> float | None:
    """Share of the positions inside their 95 % ellipses."""
    return _coverage(truth, estimate, 0.95)


def coverage_99(truth: Truth, _recording: Recording, estimate: Estimate) -> float | None:
    """Share of the positions inside their 99 % ellipses."""
    return _coverage(truth, estimate, 0.99)


def log_score(truth: Truth, _recording: Recording, estimate: Estimate) -> float | None:
    """Mean log score of the poses [nats per step]."""
    if truth.poses is None or estimate.pose_covs is None:
        return None
    return mean(log_scores(pose_errors(truth.poses, estimate.poses), estimate.pose_covs))


def _coverage(truth: Truth, estimate: Estimate, level: float) -> float | None:
    if truth.poses is None or estimate.pose_covs is None:
        return None
    errors = pose_errors(truth.poses, estimate.poses)[:, :2]
    return mean(is_inside(squared_mahalanobis(errors, estimate.pose_covs[:, :2, :2]), level))
