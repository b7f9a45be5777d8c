"""Evidence of the runs for one ratio of a claim.

The effect is the geometric mean of the ratio over runs; a ratio beyond the claim's limit counts as the limit. Its
interval is that of `scoring.confidence_sequence`, corrected for the number of ratios (Bonferroni): with probability
1 - ALPHA all intervals hold after any number of runs, so a claim may be tested after every run until it is decided.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.scoring.confidence_sequence import location, log_wealth, lower_end, smallest_effect, upper_end
from slamgauge.compare.scoring.nan_stats import number
from slamgauge.compare.studies.claim_list import Claim

ALPHA = 0.05


class Evidence(NamedTuple):
    """Evidence for one ratio; figures are None with too few runs, or if they overflow.

    Attributes:
        effect: geometric mean of the ratio over runs.
        low: lower end of its interval, which holds for all ratios and after any number of runs.
        high: upper end.
        p_value: p-value of the verdict, valid in the same way; if undecided, that of the more likely verdict.
        support: log wealth of bets on the asserted range minus that of bets against it.
        runs: number of runs with both figures.
        decidable: smallest factor from an end of the range that the most runs decide with 90 % probability, if they
            scatter as these do.
    """

    effect: float | None
    low: float | None
    high: float | None
    p_value: float
    support: float
    runs: int
    decidable: float | None

    @property
    def verdict(self) -> str:
        """`holds`, `does not hold` or `undecided`."""
        if not self.p_value <= ALPHA:
            return "undecided"
        return "holds" if self.support > 0 else "does not hold"


NOTHING = Evidence(None, None, None, p_value=1.0, support=0.0, runs=0, decidable=None)


def weigh(log_ratios: Float, claim: Claim, tests: int, most: int) -> Evidence:
    """Return the evidence that a ratio is in the range of a claim.

    Args:
        log_ratios: logarithms (runs,) of the ratio in independent runs.
        claim: range and limit.
        tests: number of ratios that are tested, each on two sides.
        most: largest number of runs.
    """
    runs, limit, threshold = len(log_ratios), math.log(claim.limit), math.log(2 * tests / ALPHA)
    if not runs:
        return NOTHING
    low, high = claim.asserted
    ends = [sign * (log_ratios - math.log(end)) for sign, end in ((1.0, low), (-1.0, high)) if 0.0 < end < math.inf]
    inside = min(log_wealth(each, limit) for each in ends)
    outside = max(log_wealth(-each, limit) for each in ends)
    return Evidence(
        effect=_ratio(location(log_ratios, limit)),
        low=_ratio(lower_end(log_ratios, limit, threshold)),
        high=_ratio(upper_end(log_ratios, limit, threshold)),
        p_value=min(1.0, 2 * tests * math.exp(-max(inside, outside, 0.0))),
        support=inside - outside,
        runs=runs,
        decidable=_ratio(smallest_effect(log_ratios, limit, threshold, most)),
    )


def _ratio(logarithm: float) -> float | None:
    """Return the ratio with this logarithm; None if either is infinite."""
    if not math.isfinite(logarithm):
        return None
    with np.errstate(over="ignore"):
        return number(np.exp(logarithm))
