"""Bounds on an estimator's errors as one assertion, for tests of filters and for grading."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.intervals import Interval, defined_mean, mean_interval, ratio_interval
from slamgauge.compare.scoring.runs import FIRST_STEP
from slamgauge.compare.scoring.scores import Score
from slamgauge.errors import UserError

NO_COVS = "returns no pose_covs, so consistency cannot be checked; return them"


def assert_error_bounds(
    score: Score | Sequence[Score],
    *,
    max_ate_m: float | None = None,
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
    if (max_ate_m, nees_level, nis_level, reference) == (None,) * 4:
        raise UserError("no bound given; pass max_ate_m, nees_level, nis_level or reference")
    last = np.array([each.nees[-1] for each in scores])
    total, dof = (np.array([each[key] for each in scores]) for key in ("nis_total", "nis_dof_total"))
    regular = "it needs the true last pose and an Estimate with a regular pose_covs[-1]"
    broken = [
        _ate_above(ates(scores), max_ate_m),
        _outside("pose NEES at the last step", last, np.full(len(last), 3), len(last), nees_level, regular),
        _outside("NIS", total, dof, dof.sum(), nis_level, "return an Estimate with nis and nis_dof"),
        *([] if reference is None else against_reference(scores, reference)[1]),
    ]
    failures = [f"  {text}" for text in broken if text]
    if failures:
        raise AssertionError("\n".join([f"{len(failures)} error bound(s) failed:", *failures]))


def _ate_above(errors: Float, bound: float | None) -> str:
    """Return why the mean ATE [m] of runs fails its bound, or nothing."""
    if bound is None:
        return ""
    if not bound > 0:
        raise UserError(f"max_ate_m = {bound}: no error can keep it; give a bound > 0")
    if missing := int(np.isnan(errors).sum()):
        return f"ate_m is missing in {missing} of {len(errors)} run(s): evaluate with a Truth that has poses"
    average = float(errors.mean())
    return "" if average <= bound else f"ate_m = {average:.6g}{_runs(errors)} exceeds max_ate_m = {bound:.6g}"


def _outside(name: str, totals: Float, dof: Int, count: float, level: float | None, remedy: str) -> str:
    """Return why the sum of chi-square totals, shown divided by `count`, is outside its band, or nothing."""
    if level is None:
        return ""
    low, high = chi2_band(level, max(dof.sum(), 1))
    missing, total = np.isnan(totals) | (dof <= 0), float(totals.sum())
    if missing.any():
        return f"{name} is missing in {missing.sum()} of {len(missing)} run(s): {remedy}"
    if low <= total <= high:
        return ""
    band = f"[{low / count:.4g}, {high / count:.4g}], the {100 * level:g} % chi-square band"
    side = "sure" if total > high else "cautious"
    return f"{name}{_runs(totals)} = {total / count:.4g} is outside {band}: the estimator is too {side}"


def _runs(figures: Float) -> str:
    return f" (mean of {len(figures)} runs)" if len(figures) > 1 else ""


def against_reference(
    scores: Sequence[Score], reference: Sequence[Score]
) -> tuple[dict[str, Interval | None], tuple[str, ...]]:
    """Compare the runs of an estimator with those of a reference on the same runs, in the same order.

    A bound fails if the whole 95 % interval of a paired ratio is beyond it: the ATE may be 1.05 times the reference's;
    the NEES 1.2 times, unless its own interval reaches down to a consistent estimate's; the sigmas of position and
    heading 0.9 to 1.1 times, unless the NEES is nearer to a consistent estimate's than the reference's.

    Returns:
        Ratios of means by key, estimator over reference, and a line for each broken bound.
    """
    if [len(each.nees) for each in scores] != [len(each.nees) for each in reference]:
        other = f"{len(reference)} scores for {len(scores)} of other runs"
        raise UserError(f"reference: {other}; score both on the same runs")
    if len(scores) < 2:
        raise UserError("reference: a single run has no interval; give the scores of at least 2 runs")
    own, other = (mean_interval(late_nees(each)) for each in (scores, reference))
    is_further_off = own is not None and other is not None and _off(own) >= _off(other)
    rules = {
        "ate_ratio": ("ATE", ates, 0.0, 1.05, True),
        "nees_ratio": ("NEES", late_nees, 0.0, 1.2, own is not None and own.is_above(1.0)),
        "sigma_position_ratio": ("sigma of the position", partial(_late_sigma, of=[0, 1]), 0.9, 1.1, is_further_off),
        "sigma_heading_ratio": ("sigma of the heading", partial(_late_sigma, of=[2]), 0.9, 1.1, is_further_off),
    }
    ratios: dict[str, Interval | None] = {}
    broken = [NO_COVS] if own is None and other is not None else []
    for key, (name, figure, least, most, is_judged) in rules.items():
        ratio = ratios[key] = ratio_interval(figure(scores), figure(reference))
        if ratio is None or ratio.low is None or not is_judged:
            continue
        text = f"{name} is {ratio.mean:.3g} ± {ratio.mean - ratio.low:.2g} times the reference's"
        if ratio.is_below(least):
            broken.append(f"{text}, less than {least:g}: it is too sure")
        elif ratio.is_above(most):
            broken.append(f"{text}, more than {most:g}{': it is too cautious' if least else ''}")
    return ratios, tuple(broken)


def ates(scores: Sequence[Score]) -> Float:
    """Return the ATE [m] of runs (R,), NaN if undefined."""
    return np.array([each["ate_m"] for each in scores], dtype=np.float64)


def late_nees(scores: Sequence[Score]) -> Float:
    """Return the mean of the pose NEES over 3 from the 11th step on (R,)."""
    return np.array([defined_mean(each.nees[FIRST_STEP:]) for each in scores], dtype=np.float64) / 3


def _late_sigma(scores: Sequence[Score], of: list[int]) -> Float:
    """Return the RMS of the sigma of these components of the pose together, from the 11th step on (R,)."""
    squares = [defined_mean(np.square(each.sigmas[FIRST_STEP:, of]).sum(axis=1)) for each in scores]
    return np.sqrt(np.array(squares, dtype=np.float64))


def _off(nees: Interval) -> float:
    """Return how far a NEES over its degrees of freedom is from 1, in either direction."""
    return float(abs(np.log(max(nees.mean, np.finfo(float).tiny))))
