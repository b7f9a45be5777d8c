"""Verdicts in words: what the figures of an estimator say, in a sentence, by rules and nothing else.

A thing is said if it is significant, and if it is worth saying: at least WORTH in a sigma or in a ratio.
docs/verdicts.md has the rules too.

Significance of NEES needs no knowledge of how its errors last. Its mean over the steps of a run varies most where they
last for the whole run, and is then chi-square with 3 degrees of freedom; so the mean over R independent runs is held
against the two-sided band of chi-square with 3 R. A right filter leaves that with probability 1 - LEVEL at most.
NIS is white: its total is chi-square with all its degrees of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from slamgauge.compare.estimators.registry import OPTIMA, REGISTRY
from slamgauge.compare.scoring.aggregation import late_coverage, late_means, total_nis
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.intervals import Interval, mean_interval, ratio_interval
from slamgauge.compare.scoring.nan_stats import mean
from slamgauge.compare.scoring.optimum_figures import is_misfit_in_runs, share_of_doubt
from slamgauge.compare.scoring.runs import Runs, paired

LEVEL = 0.99  # of the two-sided chi-square bands of NEES and NIS
WORTH = 0.05  # the smallest factor less one that is worth a word, and what a study should resolve

# relative standard deviation of the ATE between runs whose errors last for the whole run: that of a Rayleigh variable
SCATTER = math.sqrt(4 / math.pi - 1)
NORMAL = 1.959964  # standard deviations of a 95 % interval


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """The figures that a verdict is drawn from; None where there is none.

    Attributes:
        runs: independent runs with a NEES.
        nees_per_dof: mean pose NEES over 3.
        coverage_95: share of the positions inside their 95 % ellipses.
        nis_per_dof: NIS over its degrees of freedom.
        nis_dof: those, of all runs together.
        ratio: ATE over that of an optimum that is not in doubt, and not the estimate itself.
        ratio_runs: how many runs it is of.
        optimum: what that optimum is called.
        wrong_associations: mean over runs.
    """

    runs: int
    nees_per_dof: float | None
    coverage_95: float | None
    nis_per_dof: float | None
    nis_dof: int
    ratio: Interval | None = None
    ratio_runs: int = 0
    optimum: str = "optimum"
    wrong_associations: float | None = None


def verdict(evidence: Evidence) -> str | None:
    """The sentence, without a full stop; None if there is nothing worth saying."""
    sigma, innovations = _sigma(evidence), _innovations(evidence)
    parts = [sigma.said, _ratio(evidence), _cause(evidence, sigma, innovations), innovations.said]
    if sigma.is_wrong and innovations.fits:
        parts.append("NIS looks fine and is blind to this")
    said = [part for part in parts if part]
    return "; ".join(said) if said else None


def verdict_lines(verdicts: Mapping[str, str | None]) -> list[str]:
    """A line for each estimator of which there is something to say."""
    return [f"{name}: {said}" for name, said in verdicts.items() if said]


def single_run() -> str:
    """That one run is one, and how many would tell.

    It cannot tell by itself: errors that last for the whole run look alike from its first step to its last. So SCATTER
    is taken for the spread between runs.
    """
    return (
        f"a single run: luck is in every figure. From run to run an ATE scatters by some {100 * SCATTER:.0f} %: "
        f"about {runs_to_resolve(SCATTER)} runs resolve {100 * WORTH:g} % of it, fewer do of its ratio to an optimum "
        f"(slamgauge study --precision {WORTH:g})"
    )


def runs_to_resolve(scatter: float) -> int:
    """Runs until a 95 % interval is ±WORTH wide, for a standard deviation `scatter` between runs; two digits."""
    runs = round((NORMAL * scatter / WORTH) ** 2, 6)  # 400, not 400.0000001
    step = 10 ** max(0, math.floor(math.log10(max(runs, 1))) - 1)
    return math.ceil(runs / step) * step


def faults(evidence: Evidence) -> tuple[str, ...]:
    """What the verdict finds wrong, without its size, for tables of many estimators."""
    sigma, innovations = _sigma(evidence), _innovations(evidence)
    found: list[str] = []
    if sigma.is_wrong:
        found.append(f"claims too {'small' if (evidence.nees_per_dof or 0.0) > 1 else 'large'} a sigma")
    if _loses(evidence.ratio):
        found.append(f"loses to the {evidence.optimum}")
    if found and evidence.wrong_associations:
        found.append("takes observations for others")
    if innovations.is_wrong:
        found.append(f"innovations {'larger' if (evidence.nis_per_dof or 0.0) > 1 else 'smaller'} than it expects")
    return tuple(found)


# --- the rules -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Said:
    """What is said of a claimed size: nothing if there is no figure; whether it fits, or is wrong, or neither."""

    said: str = ""
    fits: bool = False
    is_wrong: bool = False


def _sigma(evidence: Evidence) -> _Said:
    """Whether errors are as large as the covariance says."""
    if evidence.nees_per_dof is None or not evidence.runs:
        return _Said()
    factor = math.sqrt(evidence.nees_per_dof)
    share = evidence.coverage_95
    ellipses = "" if share is None else f" (95 % ellipses hold {100 * share:.0f} %)"
    if not factor:
        return _Said("has no error at all, whatever sigma it claims: look whether it is given the truth", is_wrong=True)
    if _is_off(evidence.nees_per_dof, 3 * evidence.runs):
        too = f"{factor:.2g} times too small" if factor > 1 else f"{1 / factor:.2g} times too large"
        return _Said(f"claims {too} a sigma{ellipses}", is_wrong=True)
    if evidence.runs == 1:
        return _Said(fits=True)
    return _Said(f"its sigmas are right as far as {evidence.runs} runs tell{ellipses}", fits=True)


def _innovations(evidence: Evidence) -> _Said:
    """Whether innovations are as large as the filter expects."""
    if evidence.nis_per_dof is None or not evidence.nis_dof:
        return _Said()
    if not _is_off(evidence.nis_per_dof, evidence.nis_dof):
        return _Said(fits=True)
    factor = math.sqrt(evidence.nis_per_dof)
    small = "noise is stated too small, or associations are wrong"
    large = "noise is stated too large, or a gate cuts them off"
    said = f"innovations are {factor:.2g} times as large as it expects: {small if factor > 1 else large}"
    return _Said(said, is_wrong=True)


def _is_off(figure: float, dof: int) -> bool:
    """Whether a chi-square figure over its degrees of freedom is significantly off 1, and by a sigma worth a word."""
    low, high = chi2_band(LEVEL, dof)
    return not low <= figure * dof <= high and not 1 / (1 + WORTH) <= math.sqrt(figure) <= 1 + WORTH


def _ratio(evidence: Evidence) -> str:
    """How much larger errors are than the optimum's."""
    ratio = evidence.ratio
    if ratio is None or ratio.low is None or ratio.high is None:
        return ""
    half = (ratio.high - ratio.low) / 2
    figure, of = f"{ratio.mean:.2f} ± {half:.2f}", f"the {evidence.optimum}'s error"
    if ratio.low >= 1 - WORTH and ratio.high <= 1 + WORTH:
        return f"as accurate as the {evidence.optimum} ({figure})"
    if _loses(ratio):
        return f"{figure} times {of}"
    if ratio.high < 1:
        return f"{figure} times {of}, less than that: look whether it knows more than the measurements"
    needed = runs_to_resolve(half / NORMAL * math.sqrt(evidence.ratio_runs))
    return f"{figure} times {of}, which decides nothing: about {needed} runs resolve {100 * WORTH:g} %"


def _loses(ratio: Interval | None) -> bool:
    """Whether errors are significantly larger than the optimum's, and not shown to be as good as those."""
    if ratio is None or ratio.low is None or ratio.high is None:
        return False
    return ratio.low > 1 and ratio.high > 1 + WORTH


def _cause(evidence: Evidence, sigma: _Said, innovations: _Said) -> str:
    """Where a loss comes from, as far as the figures tell: by elimination of what is known to be right."""
    loses = _loses(evidence.ratio)
    if not loses and not sigma.is_wrong:
        return ""
    if evidence.wrong_associations:
        wrong = evidence.wrong_associations
        return f"takes {wrong:{'.0f' if wrong >= 10 else '.2g'}} observations a run for others"
    is_too_sure = sigma.is_wrong and evidence.nees_per_dof is not None and evidence.nees_per_dof > 1
    if loses and is_too_sure and innovations.fits and evidence.wrong_associations == 0:
        return "lost by itself, associations and noise being right: its linearisation, or a bug"
    return ""


# --- what the catalogue names --------------------------------------------------------------------


def verdict_over_runs(runs: Runs, others: Mapping[str, Runs]) -> str | None:
    """The verdict on the runs of an estimator, beside those of all by name."""
    return verdict(_evidence(runs, others)) if runs.kind else None


def faults_over_runs(runs: Runs, others: Mapping[str, Runs]) -> tuple[str, ...]:
    """The faults of an estimator in its runs, beside those of all by name."""
    return faults(_evidence(runs, others)) if runs.kind else ()


def _evidence(runs: Runs, others: Mapping[str, Runs]) -> Evidence:
    name = OPTIMA[runs.kind]
    nees = late_means(runs.series["nees_pose"])
    coverage = late_coverage(0.95)(runs, others)
    nis = total_nis(runs, others)
    ratio, common = _over_optimum(runs, others.get(name))
    return Evidence(
        runs=int(np.sum(~np.isnan(nees))),
        nees_per_dof=_mean_of(mean_interval(nees / 3)),
        coverage_95=_mean_of(coverage),
        nis_per_dof=_mean_of(nis),
        nis_dof=int(np.nansum(runs.figures["nis_dof_total"])),
        ratio=ratio,
        ratio_runs=common,
        optimum=REGISTRY[name].title,
        wrong_associations=mean(runs.figures["wrong_associations"]),
    )


def _over_optimum(runs: Runs, optimum: Runs | None) -> tuple[Interval | None, int]:
    """The ratio of ATEs and its number of runs; None against oneself, and against an optimum in doubt or misfit."""
    if optimum is None or optimum is runs or share_of_doubt(optimum.figures["optimum_check_sigma"]):
        return None, 0
    if is_misfit_in_runs(mean_interval(optimum.figures["chi_square_per_dof"])):
        return None, 0
    ours, theirs = paired(runs, optimum)
    return ratio_interval(runs.figures["ate_m"][ours], optimum.figures["ate_m"][theirs]), len(ours)


def _mean_of(interval: Interval | None) -> float | None:
    return None if interval is None else interval.mean
