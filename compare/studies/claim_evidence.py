"""What the runs say of one ratio that a claim is about.

The effect is the geometric mean of the ratio over runs; a run farther off than the claim's limit counts as at the
limit. Its interval is that of `scoring.confidence_sequence`, corrected for the number of ratios (Bonferroni): with
probability 1 - ALPHA all intervals hold after any number of runs, so a claim may be tested after every run until it is
decided.
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
    """What the runs say of one ratio; figures are None where there are too few runs, or where they overflow.

    Attributes:
        effect: its geometric mean over runs.
        low: lower end of its interval, which holds for all ratios and after any number of runs.
        high: upper end.
        p_value: that the verdict is wrong, likewise; of the more likely one where there is none.
        support: logarithm of the wealth of bets on the range that is asserted, less that of bets against it.
        runs: how many had both figures.
        decidable: the factor from an end of the range that is decided with 90 % after the most runs, if they scatter
            as these do.
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
    """Evidence that the ratio with these logarithms (runs,) lies in the range that a claim asserts.

    Args:
        log_ratios: of independent runs.
        claim: says range and limit.
        tests: how many ratios are tested.
        most: how many runs there may be.
    """
    runs, limit, threshold = len(log_ratios), math.log(claim.limit), log_threshold(tests)
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


def log_threshold(tests: int) -> float:
    """Logarithm of the wealth that decides one of so many ratios, each to two sides."""
    return math.log(2 * tests / ALPHA)


def _ratio(logarithm: float) -> float | None:
    """The ratio with this logarithm; None if either is infinite."""
    if not math.isfinite(logarithm):
        return None
    with np.errstate(over="ignore"):
        return number(np.exp(logarithm))
