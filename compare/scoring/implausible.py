"""Estimates that are significantly better than the causal optimum: no filter is, so they use more than it may."""

from __future__ import annotations

from slamgauge.compare.scoring.consistency import chi2_band, squared_mahalanobis
from slamgauge.compare.scoring.intervals import LEVEL, Interval
from slamgauge.compare.scoring.nan_stats import mean
from slamgauge.compare.scoring.optimum_figures import is_misfit
from slamgauge.compare.scoring.scores import pose_covs_of
from slamgauge.compare.scoring.trajectory_error import pose_errors
from slamgauge.estimate import Estimate
from slamgauge.truth import Truth

SURE = 0.999  # probability of the two-sided interval: of 2000 estimators as good as the optimum one is reported
FAR_BELOW = 0.1  # largest share of the optimum's own figure
WHY = "no filter can be; check whether it uses the truth, later measurements or the scenario"


def beats_the_optimum(ratio: Interval | None, runs: int) -> str | None:
    """Return a note if a ratio to the causal optimum's ATE over runs is significantly below 1, else None."""
    from scipy.special import stdtrit  # here: scipy is slow to start

    if ratio is None or ratio.high is None:
        return None
    wider = stdtrit(runs - 1, (1 + SURE) / 2) / stdtrit(runs - 1, (1 + LEVEL) / 2)
    half = float(wider * (ratio.high - ratio.mean))
    if ratio.mean + half >= 1.0:
        return None
    return f"its error is {ratio.mean:.3g} ± {half:.2g} times the causal optimum's ({SURE:.1%} interval): {WHY}"


def beats_the_optimum_in_a_run(name: str, truth: Truth, estimate: Estimate, optimum: Estimate) -> str | None:
    """Return a note if an estimate is too near the truth in one run, and the optimum fits its noise, else None."""
    if is_misfit(optimum) or not is_too_near_the_truth(truth, estimate, optimum):
        return None
    return f"{name}: significantly nearer to the truth than the causal optimum's covariance allows: {WHY}"


def is_too_near_the_truth(truth: Truth, estimate: Estimate, optimum: Estimate) -> bool:
    """Return whether the errors of one run are significantly too small for the causal optimum's covariance.

    Their mean squared Mahalanobis distance over time varies most if all steps have the same error: then it is
    chi-square with 3 degrees of freedom, and below its band with probability 0.0005. The optimum's own distance must
    be much larger; it is not if the start is not drawn from the prior, for instance.
    """
    if truth.poses is None or estimate.kind != "filtered":
        return False
    covs = pose_covs_of(optimum)
    own, best = (mean(squared_mahalanobis(pose_errors(truth.poses, each.poses), covs)) for each in (estimate, optimum))
    return own is not None and best is not None and own < chi2_band(SURE, 3)[0] and own < FAR_BELOW * best
