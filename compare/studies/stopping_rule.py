"""Paired comparisons of a study's estimators, and the rule that ends a study when the ratios are precise enough.

A ratio is the mean ATE of one estimator divided by the mean ATE of another on the same runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from slamgauge.compare.estimators.registry import BOUNDS, CAUSAL, DEAD_RECKONING, HINDSIGHT
from slamgauge.compare.estimators.requests import Asked
from slamgauge.compare.scoring.aggregation import late_means
from slamgauge.compare.scoring.intervals import LEVEL, Interval, Paired, compare_paired, ratio_interval
from slamgauge.compare.scoring.runs import Ates, Runs, paired
from slamgauge.compare.scoring.sequential import Look, plan_looks, repeated_p_value
from slamgauge.compare.scoring.text_page import Grid
from slamgauge.compare.scoring.text_table import interval_cell
from slamgauge.display import counted
from slamgauge.errors import UserError

SMALLEST_P = 1e-6  # smaller ones are printed as `<1e-06`

Pair = tuple[str, str]  # labels of numerator and denominator
Against = Mapping[str, Mapping[str, Mapping[str, Paired]]]  # keys: reference estimator, estimator, figure


class Until(NamedTuple):
    """Stopping rule: each interval's half-width is below `precision` times its ratio, or `most` runs are done."""

    precision: float
    most: int


@dataclass(frozen=True)
class Precision:
    """The look at which a study with the stopping rule `until` ended, and its ratios of ATEs.

    Attributes:
        until: stopping rule.
        look: last look.
        ratios: ratio of each pair, with an interval that holds at all looks at once with probability 95 %.
        unknown: pairs without a ratio, because no run has estimates of both estimators.
    """

    until: Until
    look: Look
    ratios: dict[Pair, Interval]
    unknown: tuple[Pair, ...] = ()

    @property
    def is_settled(self) -> bool:
        """Whether the study can stop: every known ratio is precise enough. Unknown pairs do not count."""
        return all(is_narrow(ratio, self.until.precision) for ratio in self.ratios.values())

    @property
    def reached(self) -> bool:
        """Whether every ratio is known and precise enough."""
        return self.is_settled and not self.unknown

    def to_json(self) -> dict[str, Any]:
        """Return the entry `precision` of summary.json."""
        return {
            "target": self.until.precision,
            "reached": self.reached,
            "look": self.look.number,
            "looks": self.look.of,
            "most_runs": self.until.most,
            "ratios": [{"of": ours, "over": theirs, **each._asdict()} for (ours, theirs), each in self.ratios.items()],
        }

    def line(self) -> str:
        """Return the line with the ratios that is printed below the table of a study."""
        ended = f"{'reached' if self.reached else 'not reached'} with {self.look.runs} runs"
        known = [f"{ours} / {theirs} {interval_cell(each, '{:.3f}')}" for (ours, theirs), each in self.ratios.items()]
        known += [f"{ours} / {theirs} unknown, no run has both" for ours, theirs in self.unknown]
        return (
            f"precision {100 * self.until.precision:g} %: {ended} (look {self.look.number} of at most {self.look.of}); "
            f"ratios of ATEs with 95 % intervals that hold at all looks: {', '.join(known)}"
        )


def is_narrow(ratio: Interval, precision: float) -> bool:
    """Return whether the half-width of the ratio's interval is below `precision` times the ratio."""
    return ratio.low is not None and ratio.high is not None and ratio.high - ratio.low < 2 * precision * ratio.mean


def looks_of(runs: int, until: Until | None) -> tuple[Look, ...]:
    """Return the looks of a study: one look after `runs` runs, or with a stopping rule the planned looks from there on.

    Raises:
        UserError: the precision or the number of runs is out of range.
    """
    if until is None:
        return (Look(runs, 1, 1, LEVEL),)
    if not 0 < until.precision < 1:
        raise UserError(f"precision: {until.precision:g} is not a share; give one between 0 and 1, for example 0.02")
    if until.most < runs:
        raise UserError(f"max-runs: {until.most} are fewer than the {runs} to begin with; give more, or fewer --runs")
    return plan_looks(runs, until.most)


def pairs_to_resolve(asked: Sequence[Asked], against: Sequence[str]) -> list[Pair]:
    """Return the pairs of the stopping rule: each estimator and each estimator of `against`, by default the optima.

    Raises:
        UserError: no pair exists, because no reference estimator is requested.
    """
    over = against or [each.label for each in asked if each.name in (CAUSAL, HINDSIGHT)]
    pairs = [(each.label, other) for other in over for each in asked if each.label != other and not each.is_bound]
    if not pairs:
        raise UserError("precision: no ratio exists; add causal to --estimators, or name a reference with --against")
    return pairs


def ratios_at(look: Look, pairs: Sequence[Pair], ates: Mapping[str, Ates]) -> dict[Pair, Interval]:
    """Return the ratios of ATEs of pairs on their common runs at a look; pairs without a common run are omitted."""
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
    """Return paired comparisons of ATE and NEES/3 with each reference in `names`, valid at all looks at once."""
    return {
        name: {
            label: _compared(runs, loaded[name], looks, look)
            for label, runs in loaded.items()
            if label != name and label not in BOUNDS
        }
        for name in names
    }


def compare_user_code(asked: Sequence[Asked], loaded: Mapping[str, Runs], look: Look) -> tuple[tuple[str, str], ...]:
    """Return pairs of a user estimator and a sentence with the ratio of its ATE and that of a built-in filter.

    Each user estimator is compared with each built-in filter of the same kind, filtered or smoothed.
    """
    built_in = [each for each in asked if each.name and not each.is_told and each.name != DEAD_RECKONING]
    sentences: list[tuple[str, str]] = []
    for mine in (each.label for each in asked if not each.name):
        for other in (each.label for each in built_in if loaded[each.label].kind == loaded[mine].kind):
            found = _compared(loaded[mine], loaded[other], (look,), look).get("ate_m")
            if found is None or found.ratio is None:
                continue
            opening = f"the ATE of {mine} is {interval_cell(found.ratio, '{:.3f}')} times that of {other} "
            runs = counted(found.runs, "run")
            sentences.append((mine, f"{opening}on the same {runs}{_significance(found.ratio)}"))
    return tuple(sentences)


def _significance(ratio: Interval) -> str:
    """Return the end of a sentence, which states whether the interval of a ratio excludes 1 to the printed digits."""
    if ratio.low is None or ratio.high is None:
        return "; an interval needs 2 runs"
    is_significant = round(ratio.low, 3) > 1 or round(ratio.high, 3) < 1
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
    """Return the comparison with a p-value that is valid at all looks at once; the interval already is."""
    if found.p_value is None or len(looks) == 1:
        return found
    return found._replace(p_value=repeated_p_value(looks, look, found.p_value))


def against_parts(against: Against) -> list[Grid | str]:
    """Return a table for each reference estimator, each after an empty line."""
    parts: list[Grid | str] = []
    for name, others in against.items():
        rows = [[f"against {name}", "runs", "x ATE", "ATE less [m]", "p", "x NEES", "NEES/3 less", "p"]]
        for label, figures in others.items():
            ate, nees = figures.get("ate_m"), figures.get("nees_pose_per_dof")
            rows.append([label, str(ate.runs if ate else 0), *_cells(ate, "{:+.3f}"), *_cells(nees, "{:+.2f}")])
        parts += ["", Grid(rows)]
    return parts


def _cells(found: Paired | None, form: str) -> list[str]:
    if found is None:
        return ["-", "-", "-"]
    p = found.p_value
    p_text = "-" if p is None else f"<{SMALLEST_P:g}" if p < SMALLEST_P else f"{p:.2g}"
    difference = interval_cell(found.difference, form).replace("± +", "± ")
    return [interval_cell(found.ratio, "{:.3f}"), difference, p_text]
