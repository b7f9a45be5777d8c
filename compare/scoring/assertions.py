"""Bounds on an estimator's errors as one assertion, for tests of filters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.optimum_figures import share_of_doubt
from slamgauge.compare.scoring.optimum_notes import distance_from_optimum, distance_in_runs
from slamgauge.compare.scoring.reference_comparison import against_reference
from slamgauge.compare.scoring.scores import Score
from slamgauge.errors import UserError


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
    figures: list[float | None] = [getattr(score, name) for score in scores]
    known = [figure for figure in figures if figure is not None]
    if len(known) < len(figures):
        return _missing(name, len(figures) - len(known), len(figures), remedy)
    mean = float(np.mean(known))
    return "" if mean <= bound else f"{name} = {mean:.6g}{_runs(scores)} exceeds max_{name} = {bound:.6g}"


def _ratio_below(scores: list[Score], bound: float | None) -> str:
    """Return why the ratio to the optimum fails its bound, or that the optimum is in doubt, or nothing."""
    verdict = _mean_below("ratio_to_optimum", "evaluate with a Truth and an optimum", scores, bound)
    checks = [score.yardstick_check_sigma for score in scores]
    if len(checks) == 1:
        doubt = distance_from_optimum("the optimum", checks[0])
    else:
        doubt = distance_in_runs("the optimum", share_of_doubt(np.array(checks, dtype=np.float64)))
    if bound is None or doubt is None:
        return verdict
    return f"ratio_to_optimum cannot be evaluated, as {doubt}: give max_ate_m instead"


def _nees_inside(scores: list[Score], level: float) -> str:
    last = np.array([score.nees[-1] for score in scores])
    band = chi2_band(level, 3 * len(last))
    undefined = int(np.isnan(last).sum())
    if undefined:
        remedy = "it needs the true last pose and an Estimate with a regular pose_covs[-1]"
        return _missing("pose NEES at the last step", undefined, len(last), remedy)
    return _outside(f"pose NEES at the last step{_runs(scores)}", float(last.sum()), band, len(last), level)


def _nis_inside(scores: list[Score], level: float) -> str:
    dof = sum(score.nis_dof_total for score in scores)
    missing = sum(score.nis_dof_total <= 0 for score in scores)
    band = chi2_band(level, max(dof, 1))
    if missing:
        return _missing("NIS", missing, len(scores), "return an Estimate with nis and nis_dof")
    return _outside(f"NIS per degree of freedom{_runs(scores)}", sum(s.nis_total for s in scores), band, dof, level)


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


def _missing(name: str, missing: int, runs: int, remedy: str) -> str:
    return f"{name} is missing in {missing} of {runs} run(s): {remedy}"


def _runs(scores: list[Score]) -> str:
    return f" (mean of {len(scores)} runs)" if len(scores) > 1 else ""
