"""What an optimum says of itself: whether it is one, whether the model fits, what it leaves out."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.nan_stats import mean
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import NOBODY, Truth

MISFIT_LEVEL = 0.999  # of the two-sided chi-square band that the residuals of an optimum must leave to be implausible
MISFIT = 0.05  # by which chi2/dof must be off 1, too: less is not worth a warning
CHECK_LIMIT = 0.05  # sigmas: a causal optimum that is farther from hindsight's at the end is in doubt


def is_in_doubt(check: float | None) -> bool:
    """Whether an optimum was checked, and is too far from hindsight's for figures against it to stand unmarked."""
    return check is not None and check > CHECK_LIMIT


def is_misfit(optimum: Estimate) -> bool:
    """Whether the residuals of an optimum are beyond chance, and by more than is tolerable, not those of its noise."""
    if optimum.chi_square is None or not optimum.chi_square_dof:
        return False
    low, high = chi2_band(MISFIT_LEVEL, optimum.chi_square_dof)
    per_dof = optimum.chi_square / optimum.chi_square_dof
    return not low <= optimum.chi_square <= high and abs(per_dof - 1.0) > MISFIT


def is_misfit_in_runs(fit: Interval | None) -> bool:
    """The same of the mean chi2/dof of many runs, with its 95 % interval."""
    if fit is None or fit.low is None or fit.high is None:
        return False
    return fit.low > 1.0 + MISFIT or fit.high < 1.0 - MISFIT


def share_of_doubt(checks: Float) -> float | None:
    """Share of the runs with a check (R,), NaN where there is none, whose optimum is in doubt."""
    return mean(np.where(np.isnan(checks), np.nan, checks > CHECK_LIMIT))


def unused_observations(truth: Truth, optimum: Estimate) -> int | None:
    """How many observations an optimum does not use, without those that it is told mislead; None: it does not tell."""
    if optimum.association is None:
        return None
    unused = optimum.association == NOBODY
    return int(np.sum(unused if truth.misleading is None else unused & ~truth.misleading))


# --- what the catalogue names --------------------------------------------------------------------


def check_sigma(_truth: Truth, _recording: Recording, estimate: Estimate) -> float | None:
    """The check that a causal optimum comes with; infinite where there was nothing to hold it against."""
    return estimate.optimum_check


def chi_square_per_dof(_truth: Truth, _recording: Recording, estimate: Estimate) -> float | None:
    """How large the residuals are; None without a degree of freedom."""
    if estimate.chi_square is None or not estimate.chi_square_dof:
        return None
    return estimate.chi_square / estimate.chi_square_dof


def observations_left_out(truth: Truth, _recording: Recording, estimate: Estimate) -> int | None:
    """How many observations an optimum does not use, but for those that it was told are clutter or outliers.

    What a filter rejects is another figure.
    """
    return None if estimate.chi_square is None else unused_observations(truth, estimate)
