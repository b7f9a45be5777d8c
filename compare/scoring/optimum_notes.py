"""Quality of an optimum (is it the optimum, does its model fit, what does it leave out), and the notes under tables.

No filter is better than the causal optimum: an estimate that is significantly better uses more than it may.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.intervals import LEVEL, Interval, mean
from slamgauge.compare.scoring.table import MARK
from slamgauge.display import counted
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS
from slamgauge.truth import NOBODY, Truth

CHECK_LIMIT = 0.05  # sigmas: a causal optimum that is farther from the hindsight optimum at the end is in doubt
MISFIT_LEVEL = 0.999  # probability of the two-sided chi-square band outside of which residuals are implausible
MISFIT = 0.05  # least deviation of chi2/dof from 1 that causes a warning
SURE = 0.999  # probability of the two-sided interval: one in 2000 estimators with the optimum's accuracy is reported
MARKED = f": figures relative to it are marked {MARK}"


def is_misfit(optimum: Estimate) -> bool:
    """Return whether the residuals of an optimum deviate significantly, and by more than MISFIT, from its noise."""
    chi_square, dof = optimum.chi_square, optimum.chi_square_dof
    if chi_square is None or not dof:
        return False
    low, high = chi2_band(MISFIT_LEVEL, dof)
    return not low <= chi_square <= high and abs(chi_square / dof - 1.0) > MISFIT


def is_misfit_in_runs(fit: Interval | None) -> bool:
    """Return the same for the mean chi2/dof of many runs with its 95 % interval."""
    return fit is not None and (fit.is_above(1.0 + MISFIT) or fit.is_below(1.0 - MISFIT))


def misfits(names: Sequence[str]) -> str | None:
    """Return that the residuals of these optima contradict the stated noise; None without names."""
    which = f"the residuals of {' and '.join(names)} contradict the stated noise"
    return f"{which}, so they are not optimal: figures relative to them are marked {MARK}" if names else None


def fit_of_the_model(title: str, optimum: Estimate) -> str | None:
    """Return chi2/dof of an optimum, its band, and the reason if it is outside; None without a degree of freedom."""
    dof = optimum.chi_square_dof
    if optimum.chi_square is None or not dof:
        return None
    figure = optimum.chi_square / dof
    low, high = (bound / dof for bound in chi2_band(LEVEL, dof))
    form = f".{max(2, 1 - math.floor(math.log10(high - low)))}f"  # at least two digits of the band's width
    band = f"{100 * LEVEL:g} % band {low:{form}} to {high:{form}}"
    verdict = ", above it: the stated noise is too small, or there are outliers" if figure > high else ""
    verdict = ", below it: the stated noise is too large" if figure < low else verdict
    return f"fit of the model: chi2/dof of the {title} {figure:{form}} ({dof} degrees of freedom, {band}){verdict}"


def left_out(name: str, truth: Truth | None, recording: Recording, optimum: Estimate) -> str | None:
    """Return how many observations an optimum leaves out, besides true outliers and clutter; None if none."""
    if optimum.association is None:
        return None
    unused = optimum.association == NOBODY
    if truth is not None and truth.misleading is not None:
        unused &= ~truth.misleading
    why = "" if SENSORS[recording.sensor].places_landmarks else " that bearings do not determine"
    return f"{name} leaves out {counted(int(unused.sum()), 'observation')}{why}" if unused.any() else None


def is_in_doubt(check: float | None) -> bool:
    """Return whether an optimum was checked and is too far from the hindsight optimum."""
    return check is not None and check > CHECK_LIMIT


def share_of_doubt(checks: Float) -> float | None:
    """Return the share of the checked runs (R,) whose optimum is in doubt; NaN is not checked."""
    return mean(np.where(np.isnan(checks), np.nan, checks > CHECK_LIMIT))


def doubt(name: str, check: float | None, then: str = "") -> str | None:
    """Return how far a causal optimum is from the true optimum, and `then`; None if it is near, or was not checked."""
    if check is None or not is_in_doubt(check):
        return None
    if math.isinf(check):
        return f"the optimum of some steps of {name}, or that of the whole recording, was not found{then}"
    return f"{name} is {check:.2g} sigma from the optimum at a checked step{then}"


def doubt_in_runs(name: str, share: float | None, then: str = MARKED) -> str | None:
    """Return in which share of many runs a causal optimum is far from the true optimum, and `then`; None if in none."""
    far = f"{name} is more than {CHECK_LIMIT:g} sigma from the optimum at a checked step"
    return f"{far} in {share:.1%} of the runs{then}" if share else None


def at_places(name: str, shares: Mapping[str, float | None], then: str = MARKED) -> list[str]:
    """Return `doubt_in_runs` of an optimum at several places: one line for places with equal shares."""
    return placed({place: doubt_in_runs(name, share, then) for place, share in shares.items()})


def placed(texts: Mapping[str, str | None]) -> list[str]:
    """Return texts by place: one line for places with the same text."""
    lines: dict[str, list[str]] = {}
    for place, line in texts.items():
        if line is not None:
            lines.setdefault(line, []).append(place)
    return [f"{', '.join(places)}: {line}" for line, places in lines.items()]


def beats_the_optimum(ratio: Interval | None, runs: int) -> str | None:
    """Return a note if a ratio to the causal optimum's ATE over runs is significantly below 1, else None."""
    from scipy.special import stdtrit  # here: scipy is slow to start

    if ratio is None or ratio.high is None:
        return None
    wider, narrower = (stdtrit(runs - 1, (1 + level) / 2) for level in (SURE, LEVEL))
    half = float(wider / narrower * (ratio.high - ratio.mean))
    if ratio.mean + half >= 1.0:
        return None
    why = "no filter can be; check whether it uses the truth, later measurements or the scenario"
    return f"its error is {ratio.mean:.3g} ± {half:.2g} times the causal optimum's ({SURE:.1%} interval): {why}"
