"""Verdicts: sentences that state by fixed rules (docs/consistency.md) what the figures of an estimator show.

A deviation is stated if it is significant and at least WORTH, in a sigma or in a ratio. The mean NEES over R runs is
compared with the two-sided band of chi-square with 3 R, the widest: that of errors that last for the whole run. So a
right filter is outside with probability 1 - BAND_LEVEL at most. The NIS is white, with all its degrees of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from slamgauge.compare.estimators.registry import OPTIMA, REGISTRY
from slamgauge.compare.scoring.consistency import chi2_band, is_inside
from slamgauge.compare.scoring.intervals import (
    WORTH,
    Interval,
    is_above,
    is_below,
    mean,
    mean_interval,
    needed_runs,
    ratio_interval,
)
from slamgauge.compare.scoring.measured import Measured
from slamgauge.compare.scoring.optimum_notes import is_misfit_in_runs
from slamgauge.compare.scoring.runs import Others, Runs, late_means, paired_figures

BAND_LEVEL = 0.99  # probability of the two-sided chi-square bands of NEES and NIS

# relative standard deviation of the ATE between runs whose errors last for the whole run: that of a Rayleigh variable
SCATTER = math.sqrt(4 / math.pi - 1)


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Figures on which a verdict is based, as in `catalogue`; None if unknown.

    `runs` is the number of independent runs with a NEES, `nis_dof` the degrees of freedom of the NIS in all runs,
    `ratio` the ATE over that of an `optimum` that is not in doubt, in `ratio_runs` runs.
    """

    runs: int = 0
    nees_per_dof: float | None = None
    coverage_95: float | None = None
    nis_per_dof: float | None = None
    nis_dof: int = 0
    ratio: Interval | None = None
    ratio_runs: int = 0
    optimum: str = "optimum"
    wrong_associations: float | None = None

    @property
    def is_sigma_off(self) -> bool:
        """Whether errors are not as large as the covariance says."""
        return _is_off(self.nees_per_dof, 3 * self.runs)

    @property
    def is_nis_off(self) -> bool:
        """Whether innovations are not as large as the filter expects."""
        return _is_off(self.nis_per_dof, self.nis_dof)

    @property
    def is_worse(self) -> bool:
        """Whether errors are significantly larger than the optimum's, and not shown to be within WORTH of them."""
        return is_above(self.ratio, 1.0) and not is_below(self.ratio, 1 + WORTH)


def _is_off(figure: float | None, dof: int) -> bool:
    """Return whether a chi-square figure over its degrees of freedom differs from 1 significantly and by WORTH."""
    if figure is None or not dof:
        return False
    low, high = chi2_band(BAND_LEVEL, dof)
    return not low <= figure * dof <= high and not 1 / (1 + WORTH) <= math.sqrt(figure) <= 1 + WORTH


def verdict(evidence: Evidence) -> str | None:
    """Return the sentence, without a full stop; None if there is nothing to state."""
    return "; ".join(sentence for _, sentence in findings(evidence) if sentence) or None


def faults(evidence: Evidence) -> tuple[str, ...]:
    """Return the faults that the verdict states, without sizes, for tables of many estimators."""
    return tuple(fault for fault, _ in findings(evidence) if fault)


def findings(evidence: Evidence) -> list[tuple[str, str]]:
    """Return what the figures show: faults without their sizes, and the parts of the verdict; both may be empty."""
    return [_sigma(evidence), _ratio(evidence), _cause(evidence), _innovations(evidence)]


def verdict_lines(verdicts: Mapping[str, str | None]) -> list[str]:
    """Return a line for each estimator with a verdict."""
    return [f"{name}: {text}" for name, text in verdicts.items() if text]


def single_run(study: str) -> str:
    """Return how much the ATE varies from run to run, and the command `study` of many runs, if it is not empty.

    One run cannot show this, because errors may last for all of it: SCATTER is the assumed spread between runs.
    """
    text = f"One run: from run to run the ATE varies by about {100 * SCATTER:.0f} % of its mean"
    return f"{text}. For conclusions use many runs: {study}" if study else text


# --- parts of the verdict ------------------------------------------------------------------------


def _sigma(evidence: Evidence) -> tuple[str, str]:
    if evidence.nees_per_dof is None or not evidence.runs:
        return "", ""
    factor = math.sqrt(evidence.nees_per_dof)
    size = "small" if factor > 1 else "large"
    fault = f"claims too {size} a sigma" if evidence.is_sigma_off else ""
    if not factor:
        return fault, "has no error at all, whatever sigma it claims: check whether it receives the truth"
    share = evidence.coverage_95
    ellipses = "" if share is None else f" (95 % ellipses contain {100 * share:.0f} %)"
    if fault:
        return fault, f"claims {max(factor, 1 / factor):.2g} times too {size} a sigma{ellipses}"
    return "", "" if evidence.runs == 1 else f"its sigmas are right as far as {evidence.runs} runs show{ellipses}"


def _ratio(evidence: Evidence) -> tuple[str, str]:
    ratio = evidence.ratio
    if ratio is None or ratio.low is None or ratio.high is None:
        return "", ""
    figure = f"{ratio.mean:.2f} ± {(ratio.high - ratio.low) / 2:.2f}"
    if ratio.low >= 1 - WORTH and ratio.high <= 1 + WORTH:
        return "", f"as accurate as the {evidence.optimum} ({figure})"
    text = f"{figure} times the {evidence.optimum}'s error"
    if evidence.is_worse:
        return f"worse than the {evidence.optimum}", text
    if ratio.high < 1 - WORTH:
        return "", f"{text}, less than the optimum's: check whether it uses more than the measurements"
    is_significant = ", not significant" if ratio.high >= 1 else ""
    return "", f"{text}{is_significant}{needed_runs(ratio, evidence.ratio_runs)}"


def _cause(evidence: Evidence) -> tuple[str, str]:
    """Return the cause of an error, by elimination of what the figures show to be right."""
    wrong, is_sigma_off = evidence.wrong_associations, evidence.is_sigma_off
    if wrong and (evidence.is_worse or is_sigma_off):
        count = f"{wrong:{'.0f' if wrong >= 10 else '.2g'}}"
        each = " per run" * (evidence.runs != 1)
        return "wrong associations", f"{count} wrong association{'s' * (count != '1')}{each}"
    is_too_sure = is_sigma_off and (evidence.nees_per_dof or 0.0) > 1
    if wrong == 0 and evidence.is_worse and is_too_sure and evidence.nis_dof and not evidence.is_nis_off:
        return "", "associations and noise are right, so the cause is its linearisation or a bug"
    return "", ""


def _innovations(evidence: Evidence) -> tuple[str, str]:
    if evidence.nis_per_dof is None or not evidence.is_nis_off:
        return "", "NIS does not show this" if evidence.is_sigma_off and evidence.nis_dof else ""
    factor = math.sqrt(evidence.nis_per_dof)
    text = f"innovations are {factor:.2g} times as large as it expects: the stated noise is too"
    if factor > 1:
        return "innovations larger than it expects", f"{text} small, or associations are wrong"
    return "innovations smaller than it expects", f"{text} large, or a gate rejects large ones"


# --- for the catalogue ---------------------------------------------------------------------------


def verdict_on_run(found: Measured) -> str | None:
    """Return the verdict on a single run; a truth without headings has the NEES of positions."""
    nees, nees_position = mean(found.nees / 3), mean(found.nees_xy / 2)
    evidence = Evidence(
        runs=1,
        nees_per_dof=nees_position if nees is None else nees,
        coverage_95=mean(is_inside(found.nees_xy, 0.95)),
        nis_per_dof=found.nis_per_dof(),
        nis_dof=found.nis_dof_total(),
        wrong_associations=found.wrong_associations(),
    )
    return verdict(evidence)


def verdict_over_runs(runs: Runs, others: Others) -> str | None:
    """Return the verdict on the runs of an estimator; `others` are the runs of all by name."""
    return verdict(_evidence(runs, others)) if runs.kind else None


def faults_over_runs(runs: Runs, others: Others) -> tuple[str, ...]:
    """Return the faults of an estimator in its runs; `others` are the runs of all by name."""
    return faults(_evidence(runs, others)) if runs.kind else ()


def _evidence(runs: Runs, others: Others) -> Evidence:
    nees = late_means(runs.series["nees_pose"])
    intervals = mean_interval(nees / 3), runs.late_coverage(others), runs.total_nis(others)
    name = OPTIMA[runs.kind]
    optimum, ratio, common = others.get(name), None, 0
    if optimum is not None and optimum is not runs and not optimum.optimum_check_share(others):
        ates = paired_figures("ate_m", runs, optimum)
        if not is_misfit_in_runs(mean_interval(optimum.figures["chi_square_per_dof"])):
            ratio, common = ratio_interval(*ates), len(ates[0])
    means = (None if each is None else each.mean for each in intervals)
    return Evidence(
        runs=int(np.sum(~np.isnan(nees))),
        **dict(zip(("nees_per_dof", "coverage_95", "nis_per_dof"), means, strict=True)),
        nis_dof=int(np.nansum(runs.figures["nis_dof_total"])),
        ratio=ratio,
        ratio_runs=common,
        optimum=REGISTRY[name].title,
        wrong_associations=mean(runs.figures["wrong_associations"]),
    )
