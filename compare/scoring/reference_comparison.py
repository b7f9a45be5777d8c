"""An estimator held against a reference on the same runs: is it shown to be worse, or to claim what is not so?

A right filter has the reference's figures but for chance, and chance is what paired intervals tell. A bound is broken
if the whole 95 % interval of a ratio lies beyond it; what is undecided passes, and more runs decide it.

    ATE            at most 1.05 times the reference's
    NEES           at most 1.2 times the reference's, unless its own interval reaches to that of a consistent estimate
    sigma          between 0.9 and 1.1 times the reference's, of position and of heading, unless the NEES is nearer to
                   that of a consistent estimate than the reference's: then the reference is to blame
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
NO_COVS = "gives no pose_covs that could be judged for consistency; return them"


@dataclass(frozen=True, kw_only=True)
class AgainstReference:
    """The figures of an estimator over those of a reference, and which bounds they break.

    Attributes:
        ate: ratio of the mean ATEs.
        nees: ratio of the mean NEES (of each run's mean from the 11th step on).
        sigma_position: ratio of the mean sigmas of the position (of each run's RMS from the 11th step on).
        sigma_heading: the same of the heading.
        broken: a line for each bound that is broken.
    """

    ate: Interval | None
    nees: Interval | None
    sigma_position: Interval | None
    sigma_heading: Interval | None
    broken: tuple[str, ...]


def against_reference(scores: Sequence[Score], reference: Sequence[Score]) -> AgainstReference:
    """Hold the runs of an estimator against those of a reference.

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
    broken: list[str | None] = [_too_large("ATE", ate, MOST_ATE)]
    if own is None and other is not None:
        broken.append(NO_COVS)
    if own is not None and own.low is not None and own.low > 1.0:
        broken.append(_too_large("NEES", nees, MOST_NEES))
    if own is not None and other is not None and _off(own) >= _off(other):
        broken += [_off_bounds("sigma of the position", position), _off_bounds("sigma of the heading", heading)]
    return AgainstReference(
        ate=ate,
        nees=nees,
        sigma_position=position,
        sigma_heading=heading,
        broken=tuple(text for text in broken if text),
    )


def ates(scores: Sequence[Score]) -> Float:
    """(R,) ATE [m] of runs, NaN where there is none."""
    return np.array([each.ate_m for each in scores], dtype=np.float64)


def late_nees(scores: Sequence[Score]) -> Float:
    """(R,) mean over the steps from the 11th on of the pose NEES, over 3."""
    return np.array([_mean(each.nees[FIRST_STEP:]) / 3 for each in scores])


def late_sigma(scores: Sequence[Score], of: list[int]) -> Float:
    """(R,) RMS over the same steps of the sigma of these components of the pose together."""
    return np.sqrt([_mean(np.square(each.sigmas[FIRST_STEP:, of]).sum(axis=1)) for each in scores])


def _mean(values: Float) -> float:
    defined = values[~np.isnan(values)]
    return float(defined.mean()) if len(defined) else np.nan


def _off(nees: Interval) -> float:
    """How far a NEES over its degrees of freedom is from that of a consistent estimate, whichever way."""
    return float(abs(np.log(max(nees.mean, np.finfo(float).tiny))))


def _too_large(name: str, ratio: Interval | None, most: float) -> str | None:
    if ratio is None or ratio.low is None or ratio.low <= most:
        return None
    return f"{name} is {_spelt(ratio)} times the reference's, more than {most:g}"


def _off_bounds(name: str, ratio: Interval | None) -> str | None:
    if ratio is None or ratio.low is None or ratio.high is None:
        return None
    if ratio.high < LEAST_SIGMA:
        return f"{name} is {_spelt(ratio)} times the reference's, less than {LEAST_SIGMA:g}: it is too sure"
    if ratio.low > MOST_SIGMA:
        return f"{name} is {_spelt(ratio)} times the reference's, more than {MOST_SIGMA:g}: it is too cautious"
    return None


def _spelt(ratio: Interval) -> str:
    assert ratio.low is not None
    return f"{ratio.mean:.3g} ± {ratio.mean - ratio.low:.2g}"
