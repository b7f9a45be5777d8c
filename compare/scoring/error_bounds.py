"""Bounds on an estimator's errors as one assertion, for tests of filters and for grading.

A bound relative to a reference on the same runs fails if the whole 95 % interval of a paired ratio is beyond it.
Otherwise the estimator passes; more runs narrow the interval.

    ATE            at most 1.05 times the reference's
    NEES           at most 1.2 times the reference's, unless its own interval reaches down to a consistent estimate's
    sigma          0.9 to 1.1 times the reference's, of position and of heading, unless the NEES is nearer to a
                   consistent estimate's than the reference's: then the reference's sigma is wrong
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Marks
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.intervals import (
    Interval,
    defined_mean,
    is_above,
    is_below,
    mean_interval,
    ratio_interval,
)
from slamgauge.compare.scoring.optimum_notes import doubt, doubt_in_runs, share_of_doubt
from slamgauge.compare.scoring.runs import FIRST_STEP
from slamgauge.compare.scoring.scores import Score
from slamgauge.errors import UserError

MOST_ATE = 1.05
MOST_NEES = 1.2
LEAST_SIGMA, MOST_SIGMA = 0.9, 1.1
NO_COVS = "returns no pose_covs, so consistency cannot be checked; return them"


def assert_error_bounds(
    score: Score | Sequence[Score],
    *,
    max_ate_m: float | None = None,
    max_ratio_to_optimum: float | None = None,
    nees_level: float | None = None,
    nis_level: float | None = None,
    reference: Sequence[Score] | None = None,
) -> None:
    """Assert that one run, or the mean over independent runs, keeps every given bound.

    The two statistical bounds are two-sided and exact: a right filter fails each of them with probability 1 - level. A
    too cautious estimator fails them like an overconfident one.

    Args:
        score: one score, or those of independent runs of one estimator.
        max_ate_m: bound on the mean ATE [m].
        max_ratio_to_optimum: bound on the mean over runs of ATE / the optimum's ATE (a mean of ratios); it cannot be
            evaluated if the optimum is in doubt.
        nees_level: probability, for instance 0.95, for the pose NEES at the last step: its sum over M runs is
            chi-square with 3 M degrees of freedom. The mean over time is not, because errors are correlated.
        nis_level: probability for the NIS: it is white, so its total over steps and runs is chi-square.
        reference: scores of another estimator on the same runs in the same order; the assertion fails if the estimator
            is significantly worse, by the rules of `slamgauge grade` (`against_reference`).

    Raises:
        AssertionError: with figure and bound of every bound that fails or cannot be evaluated.
        UserError: no bound, an impossible bound or no score is given.
    """
    __tracebackhide__ = True  # pytest then shows the caller's line
    scores = [score] if isinstance(score, Score) else list(score)
    if not scores:
        raise UserError("score: no score given; pass one Score, or one for each run")
    if (max_ate_m, max_ratio_to_optimum, nees_level, nis_level, reference) == (None,) * 5:
        raise UserError("no bound given; pass max_ate_m, max_ratio_to_optimum, nees_level, nis_level or reference")
    verdicts = [
        _mean_below("ate_m", "evaluate with a Truth that has poses", scores, max_ate_m),
        _ratio_below(scores, max_ratio_to_optimum),
        "" if nees_level is None else _nees_inside(scores, nees_level),
        "" if nis_level is None else _nis_inside(scores, nis_level),
        *([] if reference is None else against_reference(scores, reference).broken),
    ]
    failures = [f"  {verdict}" for verdict in verdicts if verdict]
    if failures:
        raise AssertionError("\n".join([f"{len(failures)} error bound(s) failed:", *failures]))


def _mean_below(name: str, remedy: str, scores: list[Score], bound: float | None) -> str:
    """Return why the mean of a figure fails its bound, or nothing."""
    if bound is None:
        return ""
    if not bound > 0:
        raise UserError(f"max_{name} = {bound}: no error can keep it; give a bound > 0")
    figures = np.array([score[name] for score in scores], dtype=np.float64)
    if np.isnan(figures).any():
        return _missing(name, np.isnan(figures), remedy)
    average = float(figures.mean())
    return "" if average <= bound else f"{name} = {average:.6g}{_runs(scores)} exceeds max_{name} = {bound:.6g}"


def _ratio_below(scores: list[Score], bound: float | None) -> str:
    """Return why the ratio to the optimum fails its bound, or that the optimum is in doubt, or nothing."""
    verdict = _mean_below("ratio_to_optimum", "evaluate with a Truth and an optimum", scores, bound)
    checks = [score["yardstick_check_sigma"] for score in scores]
    if len(checks) == 1:
        reason = doubt("the optimum", checks[0])
    else:
        reason = doubt_in_runs("the optimum", share_of_doubt(np.array(checks, dtype=np.float64)), "")
    if bound is None or reason is None:
        return verdict
    return f"ratio_to_optimum cannot be evaluated, as {reason}: give max_ate_m instead"


def _nees_inside(scores: list[Score], level: float) -> str:
    last = np.array([score.nees[-1] for score in scores])
    band = chi2_band(level, 3 * len(last))
    if np.isnan(last).any():
        remedy = "it needs the true last pose and an Estimate with a regular pose_covs[-1]"
        return _missing("pose NEES at the last step", np.isnan(last), remedy)
    return _outside(f"pose NEES at the last step{_runs(scores)}", float(last.sum()), band, len(last), level)


def _nis_inside(scores: list[Score], level: float) -> str:
    dof = np.array([score["nis_dof_total"] for score in scores])
    band = chi2_band(level, max(dof.sum(), 1))
    if (dof <= 0).any():
        return _missing("NIS", dof <= 0, "return an Estimate with nis and nis_dof")
    total = sum(score["nis_total"] for score in scores)
    return _outside(f"NIS per degree of freedom{_runs(scores)}", total, band, int(dof.sum()), level)


def _outside(name: str, total: float, band: tuple[float, float], count: int, level: float) -> str:
    """Return why a chi-square total, shown divided by `count`, is outside its band, or nothing."""
    low, high = band
    if low <= total <= high:
        return ""
    side = "sure" if total > high else "cautious"
    return (
        f"{name} = {total / count:.4g} is outside [{low / count:.4g}, {high / count:.4g}], "
        f"the {100 * level:g} % chi-square band: the estimator is too {side}"
    )


def _missing(name: str, missing: Marks, remedy: str) -> str:
    return f"{name} is missing in {missing.sum()} of {len(missing)} run(s): {remedy}"


def _runs(scores: list[Score]) -> str:
    return f" (mean of {len(scores)} runs)" if len(scores) > 1 else ""


# --- relative to a reference ---------------------------------------------------------------------


class AgainstReference(NamedTuple):
    """Ratios of means, estimator over reference, and a line for each broken bound.

    NEES and sigmas are each run's mean and RMS from the 11th step on.
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
    if is_above(own, 1.0):
        broken.append(_beyond("NEES", nees, most=MOST_NEES))
    if own is not None and other is not None and _off(own) >= _off(other):
        broken.append(_beyond("sigma of the position", position, LEAST_SIGMA, MOST_SIGMA))
        broken.append(_beyond("sigma of the heading", heading, LEAST_SIGMA, MOST_SIGMA))
    return AgainstReference(ate, nees, position, heading, tuple(text for text in broken if text))


def ates(scores: Sequence[Score]) -> Float:
    """Return the ATE [m] of runs (R,), NaN if undefined."""
    return np.array([each["ate_m"] for each in scores], dtype=np.float64)


def late_nees(scores: Sequence[Score]) -> Float:
    """Return the mean of the pose NEES over 3 from the 11th step on (R,)."""
    return np.array([defined_mean(each.nees[FIRST_STEP:]) for each in scores], dtype=np.float64) / 3


def late_sigma(scores: Sequence[Score], of: list[int]) -> Float:
    """Return the RMS of the sigma of these components of the pose together, from the 11th step on (R,)."""
    squares = [defined_mean(np.square(each.sigmas[FIRST_STEP:, of]).sum(axis=1)) for each in scores]
    return np.sqrt(np.array(squares, dtype=np.float64))


def _off(nees: Interval) -> float:
    """Return how far a NEES over its degrees of freedom is from 1, in either direction."""
    return float(abs(np.log(max(nees.mean, np.finfo(float).tiny))))


def _beyond(name: str, ratio: Interval | None, least: float = 0.0, most: float = np.inf) -> str:
    """Return that the whole interval of a ratio is beyond a bound, or nothing; too small a sigma is too sure."""
    if ratio is None or ratio.low is None:
        return ""
    text, is_sigma = f"{name} is {ratio.mean:.3g} ± {ratio.mean - ratio.low:.2g} times the reference's", least > 0.0
    if is_below(ratio, least):
        return f"{text}, less than {least:g}: it is too sure"
    if is_above(ratio, most):
        return f"{text}, more than {most:g}{': it is too cautious' if is_sigma else ''}"
    return ""
