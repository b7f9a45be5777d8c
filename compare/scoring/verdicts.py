"""Verdicts: sentences that state by fixed rules (docs/consistency.md) what the figures of an estimator show.

A deviation is stated if it is significant and at least WORTH, in a sigma or in a ratio. The mean NEES over R runs is
compared with the two-sided band of chi-square with 3 R, the widest: that of errors that last for the whole run. So a
right filter is outside with probability 1 - BAND_LEVEL at most. The NIS is white, with all its degrees of freedom.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.intervals import WORTH, Interval, needed_runs

BAND_LEVEL = 0.99  # probability of the two-sided chi-square bands of NEES and NIS


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

    def verdict(self) -> str | None:
        """Return the sentence, without a full stop; None if there is nothing to state."""
        return "; ".join(sentence for _, sentence in self._findings() if sentence) or None

    def faults(self) -> tuple[str, ...]:
        """Return the faults that the verdict states, without sizes, for tables of many estimators."""
        return tuple(fault for fault, _ in self._findings() if fault)

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
        return self.ratio is not None and self.ratio.is_above(1.0) and not self.ratio.is_below(1 + WORTH)

    def _findings(self) -> list[tuple[str, str]]:
        """Return what the figures show: faults without their sizes, and the parts of the verdict; both may be empty."""
        return [self._sigma(), self._ratio(), self._cause(), self._innovations()]

    def _sigma(self) -> tuple[str, str]:
        if self.nees_per_dof is None or not self.runs:
            return "", ""
        factor = math.sqrt(self.nees_per_dof)
        size = "small" if factor > 1 else "large"
        fault = f"claims too {size} a sigma" if self.is_sigma_off else ""
        if not factor:
            return fault, "has no error at all, whatever sigma it claims: check whether it receives the truth"
        ellipses = "" if self.coverage_95 is None else f" (95 % ellipses contain {100 * self.coverage_95:.0f} %)"
        if fault:
            return fault, f"claims {max(factor, 1 / factor):.2g} times too {size} a sigma{ellipses}"
        return "", "" if self.runs == 1 else f"its sigmas are right as far as {self.runs} runs show{ellipses}"

    def _ratio(self) -> tuple[str, str]:
        ratio = self.ratio
        if ratio is None or ratio.low is None or ratio.high is None:
            return "", ""
        figure = f"{ratio.mean:.2f} ± {ratio.half_width:.2f}"
        if ratio.low >= 1 - WORTH and ratio.high <= 1 + WORTH:
            return "", f"as accurate as the {self.optimum} ({figure})"
        text = f"{figure} times the {self.optimum}'s error"
        if self.is_worse:
            return f"worse than the {self.optimum}", text
        if ratio.high < 1 - WORTH:
            return "", f"{text}, less than the optimum's: check whether it uses more than the measurements"
        is_significant = ", not significant" if ratio.high >= 1 else ""
        return "", f"{text}{is_significant}{needed_runs(ratio, self.ratio_runs)}"

    def _cause(self) -> tuple[str, str]:
        """Return the cause of an error, by elimination of what the figures show to be right."""
        wrong, is_sigma_off = self.wrong_associations, self.is_sigma_off
        if wrong and (self.is_worse or is_sigma_off):
            count = f"{wrong:{'.0f' if wrong >= 10 else '.2g'}}"
            each = " per run" * (self.runs != 1)
            return "wrong associations", f"{count} wrong association{'s' * (count != '1')}{each}"
        is_too_sure = is_sigma_off and (self.nees_per_dof or 0.0) > 1
        if wrong == 0 and self.is_worse and is_too_sure and self.nis_dof and not self.is_nis_off:
            return "", "associations and noise are right, so the cause is its linearisation or a bug"
        return "", ""

    def _innovations(self) -> tuple[str, str]:
        if self.nis_per_dof is None or not self.is_nis_off:
            return "", "NIS does not show this" if self.is_sigma_off and self.nis_dof else ""
        factor = math.sqrt(self.nis_per_dof)
        text = f"innovations are {factor:.2g} times as large as it expects: the stated noise is too"
        if factor > 1:
            return "innovations larger than it expects", f"{text} small, or associations are wrong"
        return "innovations smaller than it expects", f"{text} large, or a gate rejects large ones"


def _is_off(figure: float | None, dof: int) -> bool:
    """Return whether a chi-square figure over its degrees of freedom differs from 1 significantly and by WORTH."""
    if figure is None or not dof:
        return False
    low, high = chi2_band(BAND_LEVEL, dof)
    return not low <= figure * dof <= high and not 1 / (1 + WORTH) <= math.sqrt(figure) <= 1 + WORTH
