"""The table of results, missed bars, messages of failures, and the worst cases."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence

from references.filters import PAIRS
from references.verdicts import FILTER_BAR, STEP_BAR, Judged, Outcome, Verdict

SHARE_OF_RECORDINGS = 0.995  # a filter must agree on this share
SHARE_OF_STEPS = 0.99  # at which `causal` must be within its bar
VERDICTS: tuple[Verdict, ...] = ("agrees", "worse", "failed", "undecided", "not compared")
UNITS = {"batch": "cost", "batch mapped": "landmarks"}  # units of differences; sigmas for all others


def table(judged: Sequence[Judged]) -> str:
    """Return a row per estimator: number of recordings per verdict, and the largest finite difference."""
    lines = [f"{'estimator':14}" + "".join(f"{each:>14}" for each in VERDICTS) + f"{'largest difference':>28}"]
    for name, outcomes in by_estimator(judged).items():
        counts = Counter(each.verdict for each in outcomes)
        largest = max((each.difference for each in outcomes if math.isfinite(each.difference)), default=math.nan)
        row = "".join(f"{counts[each]:14d}" for each in VERDICTS)
        lines.append(f"{name:14}{row}{largest:>14.1e} {UNITS.get(name, 'sigma'):13}".rstrip())
    compared, off, unflagged = steps_of(judged)
    if compared:
        lines += ["", f"causal steps: {compared}, more than {STEP_BAR} sigma off: {off} ({off / compared:.2%})"]
        lines[-1] += f", of these in estimates without a flag: {unflagged}"
    return "\n".join(lines)


def by_estimator(judged: Sequence[Judged]) -> dict[str, list[Outcome]]:
    """Return the outcomes of each estimator."""
    found: dict[str, list[Outcome]] = {}
    for each in judged:
        for outcome in each.outcomes:
            found.setdefault(outcome.estimator, []).append(outcome)
    return found


def steps_of(judged: Sequence[Judged]) -> tuple[int, int, int]:
    """Return how many steps of `causal` were compared, are above the bar, and are so without a flag."""
    counts = [(each.steps, each.steps_off, each.unflagged) for each in by_estimator(judged).get("causal", [])]
    return sum(each[0] for each in counts), sum(each[1] for each in counts), sum(each[2] for each in counts)


def bars_missed(judged: Sequence[Judged]) -> list[str]:
    """Return a line for each requirement that is not met.

    Filters agree with their reference on `SHARE_OF_RECORDINGS`, and `iekf` ends in its minimum. `batch` finds the
    minimum wherever the reference finds one, and maps the landmarks that bearings place. `causal` is within its bar at
    `SHARE_OF_STEPS`, and its own check reports the other steps.
    """
    missed: list[str] = []
    found = by_estimator(judged)
    for name in (*PAIRS, "iekf minimum"):
        good, bad = _counts(found.get(name, []))
        if good < SHARE_OF_RECORDINGS * (good + bad):
            missed.append(f"{name}: {bad} of {good + bad} recordings worse than {FILTER_BAR} sigma, or failed")
    for name, what in (("batch", "has not the minimum"), ("batch mapped", "leaves out landmarks")):
        bad = _counts(found.get(name, []))[1]
        if bad:
            missed.append(f"batch: {what} in {bad} recordings")
    compared, off, unflagged = steps_of(judged)
    if off > (1.0 - SHARE_OF_STEPS) * compared:
        missed.append(f"causal: {off} of {compared} steps more than {STEP_BAR} sigma off")
    if unflagged:
        missed.append(f"causal: {unflagged} steps off in estimates without a flag")
    return missed


def _counts(outcomes: Sequence[Outcome]) -> tuple[int, int]:
    """Return how many agree, and how many are worse or failed."""
    counts = Counter(each.verdict for each in outcomes)
    return counts["agrees"], counts["worse"] + counts["failed"]


def messages(judged: Sequence[Judged]) -> list[str]:
    """Return each error message without its numbers, and how often it occurred."""
    counts = Counter(
        (outcome.estimator, re.sub(r"\d[\d.]*(e[+-]?\d+)?", "#", outcome.note))
        for each in judged
        for outcome in each.outcomes
        if outcome.verdict == "failed"
    )
    return [f"{count:5d}  {name}: {text}" for (name, text), count in counts.most_common()]


def bad_ones(judged: Judged) -> list[Outcome]:
    """Return the outcomes that are worse than the reference, or failed."""
    return [each for each in judged.outcomes if each.verdict in ("worse", "failed")]


def worst_cases(judged: Sequence[Judged], count: int) -> list[tuple[Judged, Outcome]]:
    """Return at most `count` failed, worse or undecided outcomes per estimator, in this order, the largest first."""
    order: tuple[Verdict, ...] = ("failed", "worse", "undecided")
    found: list[tuple[Judged, Outcome]] = []
    for name in by_estimator(judged):
        rows = [(each, o) for each in judged for o in each.outcomes if o.estimator == name and o.verdict in order]
        rows.sort(key=lambda row: (order.index(row[1].verdict), -row[1].difference))
        found += rows[:count]
    return found


def describe(judged: Judged, outcome: Outcome) -> str:
    """Return an outcome in two lines."""
    head = f"{outcome.estimator} {outcome.verdict} {outcome.difference:.1e}"
    where = f"--seed {judged.seed} --only {judged.number}: {judged.steps} steps, {', '.join(judged.tags)}"
    return f"{head:36} {where}\n    {outcome.note}"
