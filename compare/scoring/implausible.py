"""Estimates that are better than the causal optimum beyond chance: no filter is, so there is something to look for."""

from __future__ import annotations

from slamgauge.compare.scoring.consistency import chi2_band, squared_mahalanobis
from slamgauge.compare.scoring.intervals import LEVEL, Interval
from slamgauge.compare.scoring.nan_stats import mean
from slamgauge.compare.scoring.scores import pose_covs_of
from slamgauge.compare.scoring.trajectory_error import pose_errors
from slamgauge.estimate import Estimate
from slamgauge.truth import Truth

SURE = 0.999  # two-sided: of 2000 estimators as good as the optimum one is called too good
FAR_BELOW = 0.1  # of the optimum's own figure, where that is small, too
WHY = "no filter is; look for the truth, the future, or what is known of the scenario in it"


def beats_the_optimum(ratio: Interval | None, runs: int) -> str | None:
    """What to say of a ratio to the causal optimum's ATE over runs; None if it may be chance."""
    from scipy.special import stdtrit  # here: scipy is slow to start

    if ratio is None or ratio.high is None:
        return None
    wider = stdtrit(runs - 1, (1 + SURE) / 2) / stdtrit(runs - 1, (1 + LEVEL) / 2)
    half = float(wider * (ratio.high - ratio.mean))
    if ratio.mean + half >= 1.0:
        return None
    return f"its error is {ratio.mean:.3g} ± {half:.2g} times the causal optimum's ({SURE:.1%} interval): {WHY}"


def is_too_near_the_truth(truth: Truth, estimate: Estimate, optimum: Estimate) -> bool:
    """Whether a single run's errors are smaller than chance allows under the causal optimum's covariance.

    Their mean squared Mahalanobis distance over time varies most if all steps err as one: then it is chi-square with 3
    degrees of freedom, and below its band with probability 0.0005. Where the optimum's own is about as small, with a
    start that is not drawn from the prior for instance, nothing can be said.
    """
    if truth.poses is None or estimate.kind != "filtered":
        return False
    covs = pose_covs_of(optimum)
    own, best = (mean(squared_mahalanobis(pose_errors(truth.poses, each.poses), covs)) for each in (estimate, optimum))
    if own is None or best is None:
        return False
    return own < chi2_band(SURE, 3)[0] and own < FAR_BELOW * best
