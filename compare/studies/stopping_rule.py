"""How finely a study tells its estimators apart: pairs that are asked for, and runs until every ratio is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from slamgauge.compare.estimators.registry import BOUNDS, CAUSAL, DEAD_RECKONING, HINDSIGHT
from slamgauge.compare.estimators.requests import Asked
from slamgauge.compare.scoring.aggregation import late_means
from slamgauge.compare.scoring.intervals import LEVEL, Interval, ratio_interval
from slamgauge.compare.scoring.paired_comparison import Paired, compare_paired
from slamgauge.compare.scoring.runs import Ates, Runs, paired
from slamgauge.compare.scoring.sequential import Look, plan_looks, repeated_p_value
from slamgauge.compare.scoring.text_page import Grid
from slamgauge.compare.scoring.text_table import interval_cell
from slamgauge.display import counted
from slamgauge.errors import UserError

SMALLEST_P = 1e-6  # what is below is not written out

Pair = tuple[str, str]  # labels: whose figure, over whose
Against = Mapping[str, Mapping[str, Mapping[str, Paired]]]  # by whom against, by whom, by key of the figure


class Until(NamedTuple):
    """Runs are added until the half-width of every ratio is below `precision` of it, and to `most` of them."""

    precision: float
    most: int


@dataclass(frozen=True)
class Precision:
    """What a study with `Until` came to: the look at which it ended, and its ratios of ATEs.

    Their intervals hold with 95 % at all looks at once, so at the one at which the study ended. `unknown` are those of
    which no run has both.
    """

    until: Until
    look: Look
    ratios: dict[Pair, Interval]
    unknown: tuple[Pair, ...] = ()

    @property
    def is_settled(self) -> bool:
        """Whether more runs would be in vain: every ratio that can be known is known well enough."""
        return all(is_narrow(ratio, self.until.precision) for ratio in self.ratios.values())

    @property
    def reached(self) -> bool:
        """Whether every ratio is known well enough."""
        return self.is_settled and not self.unknown

    def to_json(self) -> dict[str, Any]:
        """Its entry in summary.json."""
        return {
            "target": self.until.precision,
            "reached": self.reached,
            "look": self.look.number,
            "looks": self.look.of,
            "most_runs": self.until.most,
            "ratios": [{"of": ours, "over": theirs, **each._asdict()} for (ours, theirs), each in self.ratios.items()],
        }

    def lines(self) -> list[str]:
        """What stands under the table."""
        ended = f"{'reached' if self.reached else 'not reached'} with {self.look.runs} runs"
        known = [f"{ours} / {theirs} {interval_cell(each, '{:.3f}')}" for (ours, theirs), each in self.ratios.items()]
        known += [f"{ours} / {theirs} unknown, no run has both" for ours, theirs in self.unknown]
        return [
            f"precision {100 * self.until.precision:g} %: {ended} (look {self.look.number} of at most {self.look.of}); "
            f"ratios of ATEs with 95 % intervals that hold wherever it ends: {', '.join(known)}"
        ]


def is_narrow(ratio: Interval, precision: float) -> bool:
    """Whether the half-width of a ratio is below `precision` of it."""
    return ratio.low is not None and ratio.high is not None and ratio.high - ratio.low < 2 * precision * ratio.mean


def looks_of(runs: int, until: Until | None) -> tuple[Look, ...]:
    """When a study is looked at: once, after `runs`, or again and again from then on.

    Raises:
        UserError: numbers that make no sense.
    """
    if until is None:
        return (Look(runs, 1, 1, LEVEL),)
    if not 0 < until.precision < 1:
        raise UserError(f"precision: {until.precision:g} is no share; give one above 0 and below 1, for example 0.02")
    if until.most < runs:
        raise UserError(f"max-runs: {until.most} are fewer than the {runs} to begin with; give more, or fewer --runs")
    return plan_looks(runs, until.most)


def pairs_to_resolve(asked: Sequence[Asked], against: Sequence[str]) -> list[Pair]:
    """The ratios that have to be known: over those that are named, or else over the optima.

    Raises:
        UserError: there are none.
    """
    over = against or [each.label for each in asked if each.name in (CAUSAL, HINDSIGHT)]
    pairs = [(each.label, other) for other in over for each in asked if each.label != other and not each.is_bound]
    if not pairs:
        raise UserError(
            "precision: there is no ratio to be known; add causal to --estimators, or name one by --against"
        )
    return pairs


def ratios_at(look: Look, pairs: Sequence[Pair], ates: Mapping[str, Ates]) -> dict[Pair, Interval]:
    """Ratios of ATEs on the same runs, as they are known at a look; those without a common run are left out."""
    found: dict[Pair, Interval] = {}
    for ours, theirs in pairs:
        first, second = ates[ours], ates[theirs]
        common, at, there = np.intersect1d(first.run, second.run, assume_unique=True, return_indices=True)
        ratio = ratio_interval(first.ate_m[at], second.ate_m[there], look.level) if len(common) else None
        if ratio is not None:
            found[ours, theirs] = ratio
    return found


def compare_against(
    loaded: Mapping[str, Runs], names: Sequence[str], looks: Sequence[Look], look: Look
) -> dict[str, dict[str, dict[str, Paired]]]:
    """Paired comparisons of ATE and NEES/3 with each of `names`; valid at all looks at once where there are several."""
    found: dict[str, dict[str, dict[str, Paired]]] = {}
    for name in names:
        others = {label: runs for label, runs in loaded.items() if label != name and label not in BOUNDS}
        found[name] = {label: _compared(runs, loaded[name], looks, look) for label, runs in others.items()}
    return found


def compare_user_code(asked: Sequence[Asked], loaded: Mapping[str, Runs], look: Look) -> tuple[str, ...]:
    """Return a sentence for each pair of user code and a built-in filter of the same kind: the ratio of their ATEs."""
    built_in = [each for each in asked if each.name and not each.is_told and each.name != DEAD_RECKONING]
    sentences: list[str] = []
    for mine in (each.label for each in asked if not each.name):
        for other in (each.label for each in built_in if loaded[each.label].kind == loaded[mine].kind):
            found = _compared(loaded[mine], loaded[other], (look,), look).get("ate_m")
            if found is None or found.ratio is None:
                continue
            opening = f"the ATE of {mine} is {interval_cell(found.ratio, '{:.3f}')} times that of {other} "
            sentences.append(f"{opening}on the same {counted(found.runs, 'run')}{_significance(found.ratio)}")
    return tuple(sentences)


def _significance(ratio: Interval) -> str:
    """Return whether the interval of a ratio excludes 1, as the end of a sentence."""
    if ratio.low is None or ratio.high is None:
        return "; an interval needs 2 runs"
    is_significant = ratio.low > 1 or ratio.high < 1
    return f" (95 % interval): the difference is {'' if is_significant else 'not '}significant"


def _compared(runs: Runs, other: Runs, looks: Sequence[Look], look: Look) -> dict[str, Paired]:
    ours, theirs = paired(runs, other)
    figures = {
        "ate_m": (runs.figures["ate_m"][ours], other.figures["ate_m"][theirs]),
        "nees_pose_per_dof": (_nees(runs)[ours], _nees(other)[theirs]),
    }
    found = {key: compare_paired(*both, look.level) for key, both in figures.items()}
    return {key: _at_all_looks(each, looks, look) for key, each in found.items() if each is not None}


def _nees(runs: Runs) -> np.ndarray[Any, np.dtype[np.float64]]:
    return late_means(runs.series["nees_pose"]) / 3


def _at_all_looks(found: Paired, looks: Sequence[Look], look: Look) -> Paired:
    """The p-value made one of all looks; the interval is that already."""
    if found.p_value is None or len(looks) == 1:
        return found
    return found._replace(p_value=repeated_p_value(looks, look, found.p_value))


def against_parts(against: Against) -> list[Grid | str]:
    """A table for each estimator that others are compared with."""
    parts: list[Grid | str] = []
    for name, others in against.items():
        head = [f"against {name}", "runs", "x ATE", "ATE less [m]", "p", "x NEES", "NEES/3 less", "p"]
        rows = [head]
        for label, figures in others.items():
            ate, nees = figures.get("ate_m"), figures.get("nees_pose_per_dof")
            rows.append([label, str(ate.runs if ate else 0), *_cells(ate, "{:+.3f}"), *_cells(nees, "{:+.2f}")])
        parts += ["", Grid(rows)]
    return parts


def _cells(found: Paired | None, form: str) -> list[str]:
    if found is None:
        return ["-", "-", "-"]
    p = found.p_value
    said = "-" if p is None else f"<{SMALLEST_P:g}" if p < SMALLEST_P else f"{p:.2g}"
    difference = interval_cell(found.difference, form).replace("± +", "± ")
    return [interval_cell(found.ratio, "{:.3f}"), difference, said]
