"""Comparison of an estimator with a reference on the same runs: whether it is significantly worse.

A bound is broken if the whole 95 % interval of a paired ratio is beyond it. Otherwise the estimator passes; more runs
narrow the interval.

    ATE            at most 1.05 times the reference's
    NEES           at most 1.2 times the reference's, unless its own interval reaches down to a consistent estimate's
    sigma          0.9 to 1.1 times the reference's, of position and of heading, unless the NEES is nearer to a
                   consistent estimate's than the reference's: then the reference's sigma is wrong
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.scoring.aggregation import FIRST_STEP
from slamgauge.compare.scoring.intervals import Interval, mean_interval, ratio_interval
from slamgauge.compare.scoring.scores import Score
from slamgauge.errors import UserError

MOST_ATE = 1.05
MOST_NEES = 1.2
LEAST_SIGMA, MOST_SIGMA = 0.9, 1.1
NO_COVS = "returns no pose_covs, so consistency cannot be checked; return them"


@dataclass(frozen=True, kw_only=True)
class AgainstReference:
    """Figures of an estimator over those of a reference, and the broken bounds.

    Attributes:
        ate: ratio of the mean ATEs.
        nees: ratio of the mean NEES (of each run's mean from the 11th step on).
        sigma_position: ratio of the mean position sigmas (of each run's RMS from the 11th step on).
        sigma_heading: ratio of the mean heading sigmas.
        broken: a line for each broken bound.
    """

    ate: Interval | None
    nees: Interval | None
    sigma_position: Interval | None
    sigma_heading: Interval | None
    broken: tuple[str, ...]


def against_reference(scores: Sequence[Score], reference: Sequence[Score]) -> AgainstReference:
    """Compare the runs of an estimator with those of a reference.

    Args:
        scores: of independent runs.
        reference: of the same runs, in the same order.

    Raises:
        UserError: other runs, or a single one, which has no interval.
    """
    if len(scores) != len(reference) or [len(each.nees) for each in scores] != [len(each.nees) for each in reference]:
        raise UserError(
            f"reference: {len(reference)} scores for {len(scores)} of other runs; score both on the same runs"
        )
    if len(scores) < 2:
        raise UserError("reference: a single run has no interval; give the scores of at least 2 runs")
    ate = ratio_interval(ates(scores), ates(reference))
    nees = ratio_interval(late_nees(scores), late_nees(reference))
    position, heading = (ratio_interval(late_sigma(scores, of), late_sigma(reference, of)) for of in ([0, 1], [2]))
    own, other = (mean_interval(late_nees(each)) for each in (scores, reference))
    broken = [_beyond("ATE", ate, most=MOST_ATE)]
    if own is None and other is not None:
        broken.append(NO_COVS)
    if own is not None and own.low is not None and own.low > 1.0:
        broken.append(_beyond("NEES", nees, most=MOST_NEES))
    if own is not None and other is not None and _off(own) >= _off(other):
        for name, ratio in (("sigma of the position", position), ("sigma of the heading", heading)):
            broken.append(_beyond(name, ratio, LEAST_SIGMA, MOST_SIGMA, (": it is too sure", ": it is too cautious")))
    return AgainstReference(
        ate=ate,
        nees=nees,
        sigma_position=position,
        sigma_heading=heading,
        broken=tuple(text for text in broken if text),
    )


def ates(scores: Sequence[Score]) -> Float:
    """Return the ATE [m] of runs (R,), NaN if undefined."""
    return np.array([each.ate_m for each in scores], dtype=np.float64)


def late_nees(scores: Sequence[Score]) -> Float:
    """Return the mean of the pose NEES over 3 from the 11th step on (R,)."""
    return np.array([_mean(each.nees[FIRST_STEP:]) / 3 for each in scores])


def late_sigma(scores: Sequence[Score], of: list[int]) -> Float:
    """Return the RMS of the sigma of these components of the pose together, from the 11th step on (R,)."""
    return np.sqrt([_mean(np.square(each.sigmas[FIRST_STEP:, of]).sum(axis=1)) for each in scores])


def _mean(values: Float) -> float:
    defined = values[~np.isnan(values)]
    return float(defined.mean()) if len(defined) else np.nan


def _off(nees: Interval) -> float:
    """Return how far a NEES over its degrees of freedom is from 1, in either direction."""
    return float(abs(np.log(max(nees.mean, np.finfo(float).tiny))))


def _beyond(
    name: str, ratio: Interval | None, least: float = 0.0, most: float = np.inf, meanings: tuple[str, str] = ("", "")
) -> str:
    """Return that the interval of a ratio is beyond a bound, with the meaning of too small or too large; or nothing."""
    if ratio is None or ratio.low is None or ratio.high is None or (ratio.high >= least and ratio.low <= most):
        return ""
    text = f"{name} is {ratio.mean:.3g} ± {ratio.mean - ratio.low:.2g} times the reference's"
    if ratio.high < least:
        return f"{text}, less than {least:g}{meanings[0]}"
    return f"{text}, more than {most:g}{meanings[1]}"
