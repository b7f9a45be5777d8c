"""Notes on the optima under a table: fit of the model, observations left out, figures in doubt, better estimates.

No filter is better than the causal optimum: an estimate that is significantly better uses more than it may.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from slamgauge.compare.scoring.consistency import chi2_band, squared_mahalanobis
from slamgauge.compare.scoring.intervals import LEVEL, Interval
from slamgauge.compare.scoring.measured import pose_covs_of
from slamgauge.compare.scoring.nan_stats import mean
from slamgauge.compare.scoring.optimum_figures import CHECK_LIMIT, is_in_doubt, is_misfit, unused_observations
from slamgauge.compare.scoring.table import MARK, interval_cell
from slamgauge.compare.scoring.trajectory_error import pose_errors
from slamgauge.display import counted
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS
from slamgauge.truth import NOBODY, Truth

FIT_LEVEL = 0.95  # probability of the two-sided chi-square band of the fit
SURE = 0.999  # probability of the two-sided interval: one in 2000 estimators with the optimum's accuracy is reported
FAR_BELOW = 0.1  # largest share of the optimum's own figure
WHY = "no filter can be; check whether it uses the truth, later measurements or the scenario"


def fit_of_the_model(title: str, optimum: Estimate) -> str | None:
    """Return chi2/dof of an optimum, its band, and the reason if it is outside; None without a degree of freedom."""
    dof = optimum.chi_square_dof
    if optimum.chi_square is None or not dof:
        return None
    figure = optimum.chi_square / dof
    low, high = (bound / dof for bound in chi2_band(FIT_LEVEL, dof))
    digits = max(2, 1 - math.floor(math.log10(high - low)))  # at least two digits of the band's width
    verdict = ""
    if figure > high:
        verdict = ", above it: the stated noise is too small, or there are outliers"
    elif figure < low:
        verdict = ", below it: the stated noise is too large"
    return (
        f"fit of the model: chi2/dof of the {title} {figure:.{digits}f} ({dof} degrees of freedom, "
        f"{100 * FIT_LEVEL:g} % band {low:.{digits}f} to {high:.{digits}f}){verdict}"
    )


def mean_fit(title: str, fit: Interval | None) -> str | None:
    """Return the mean chi2/dof of many runs with its 95 % interval."""
    return None if fit is None else f"fit of the model: chi2/dof of the {title} {interval_cell(fit, '{:.3f}')}"


def left_out(name: str, truth: Truth | None, recording: Recording, optimum: Estimate) -> str | None:
    """Return how many landmarks and observations an optimum leaves out; None if it uses all, or this is unknown."""
    observations = unused_observations(truth or Truth(), optimum)
    if not observations:
        return None
    ids = recording.landmark
    if truth is not None and truth.association is not None and (ids is None or truth.misleading is not None):
        ids = truth.association[truth.association != NOBODY]  # the associations that optima receive
    landmarks = 0 if ids is None else int(np.sum(~np.isin(np.unique(ids), optimum.landmark_ids)))
    counts = [counted(landmarks, "landmark")] * (landmarks > 0) + [counted(observations, "observation")]
    why = "" if SENSORS[recording.sensor].places_landmarks else " that bearings do not determine"
    return f"{name} leaves out {' and '.join(counts)}{why}"


def without_misleading(names: Sequence[str], truth: Truth | None) -> str | None:
    """Return how many outliers and clutter observations the optima leave out; None if none."""
    misleading = None if truth is None else truth.misleading
    if misleading is None or not misleading.any() or not names:
        return None
    verb, count = "leaves" if len(names) == 1 else "leave", counted(int(misleading.sum()), "observation")
    return f"{' and '.join(names)} {verb} out {count}: the true outliers and clutter"


def without_headings(truth: Truth | None) -> str | None:
    """Return what a truth without headings leaves undefined, or None."""
    if truth is None or truth.poses is None:
        return None
    headless = np.isfinite(truth.poses[:, :2]).all(axis=1) & np.isnan(truth.poses[:, 2])
    if not headless.any():
        return None
    count = "no headings" if headless.all() else f"no headings at {headless.sum()} of {len(headless)} steps"
    return f"the truth has {count}: heading errors, relative errors and pose NEES are left out there"


def misfits(names: Sequence[str]) -> str | None:
    """Return that the residuals of these optima contradict the stated noise; None without names."""
    if not names:
        return None
    which = f"the residuals of {' and '.join(names)} contradict the stated noise"
    return f"{which}, so they are not optimal: figures relative to them are marked {MARK}"


def under_associations(names: Sequence[str]) -> str:
    """Return that the optima use the associations of an estimator."""
    return f"no ids, and no true associations: compared with {' and '.join(names)}, with associations right or wrong"


def distance_from_optimum(name: str, check: float | None) -> str | None:
    """Return how far a causal optimum is from the true optimum; None if it is near, or was not checked."""
    if check is None or not is_in_doubt(check):
        return None
    if math.isinf(check):
        return f"the optimum of some steps of {name}, or that of the whole recording, was not found"
    return f"{name} is {check:.2g} sigma from the optimum at a checked step"


def distance_in_runs(name: str, share: float | None) -> str | None:
    """Return in which share of many runs a causal optimum is far from the true optimum."""
    if not share:
        return None
    return f"{name} is more than {CHECK_LIMIT:g} sigma from the optimum at a checked step in {share:.1%} of the runs"


def doubt(distance: str | None) -> str | None:
    """Return the distance of an optimum with which others are compared, and that figures are marked."""
    return None if distance is None else f"{distance}: figures relative to it are marked {MARK}"


def doubt_in_runs(name: str, share: float | None) -> str | None:
    """Return the distance in many runs, and that figures are marked."""
    return doubt(distance_in_runs(name, share))


def at_places(
    name: str, shares: Mapping[str, float | None], text: Callable[[str, float | None], str | None] = doubt_in_runs
) -> list[str]:
    """Return the `text` on an optimum at several places of many runs: one line for places with equal shares."""
    return placed({place: text(name, share) for place, share in shares.items()})


def placed(texts: Mapping[str, str | None]) -> list[str]:
    """Return texts by place: one line for places with the same text."""
    lines: dict[str, list[str]] = {}
    for place, line in texts.items():
        if line is not None:
            lines.setdefault(line, []).append(place)
    return [f"{', '.join(places)}: {line}" for line, places in lines.items()]


# --- estimates that are better -------------------------------------------------------------------


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
