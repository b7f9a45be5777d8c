"""A figure of two estimators on the same runs: paired difference and ratio, with intervals and a p-value.

What both owe to the luck of a run cancels in the difference: far fewer runs tell two estimators apart than if each had
runs of its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.scoring.intervals import LEVEL, Interval, mean_interval, ratio_interval


class Paired(NamedTuple):
    """What the mean of a figure is compared with that of another estimator on the same runs.

    Attributes:
        runs: how many runs have both figures.
        difference: mean of the differences, ours less theirs, with Student's interval.
        ratio: mean over mean, with the delta method's interval; None unless their mean is positive.
        p_value: of Student's two-sided paired test that the means are the same; None of a single run.
    """

    runs: int
    difference: Interval
    ratio: Interval | None
    p_value: float | None

    def to_json(self) -> dict[str, Any]:
        """Plain numbers and None."""
        ratio = None if self.ratio is None else self.ratio._asdict()
        return {**self._asdict(), "difference": self.difference._asdict(), "ratio": ratio}


def compare_paired(ours: Float, theirs: Float, level: float = LEVEL) -> Paired | None:
    """Compare a figure of two estimators, run by run.

    Args:
        ours: (R,) the figure of each run; NaN where it is undefined, and the pair is left out.
        theirs: (R,) of the same runs.
        level: of both intervals.

    Returns:
        None if no run has both.
    """
    both = ~np.isnan(ours) & ~np.isnan(theirs)
    differences = (ours - theirs)[both]
    difference = mean_interval(differences, level)
    if difference is None:
        return None
    return Paired(len(differences), difference, ratio_interval(ours, theirs, level), _p_value(differences))


def _p_value(differences: Float) -> float | None:
    """Of Student's two-sided test that the mean of (R,) is zero."""
    from scipy.special import stdtr  # here: scipy is slow to start

    runs = len(differences)
    if runs < 2:
        return None
    mean, spread = float(differences.mean()), float(differences.std(ddof=1))
    if spread == 0:
        return 1.0 if mean == 0 else 0.0
    return 2 * float(stdtr(runs - 1, -abs(mean) / spread * np.sqrt(runs)))
