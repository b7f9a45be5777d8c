"""The table of agreement, the bars, messages of those that failed, and the worst cases."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence

from references.filters import PAIRS
from references.verdicts import FILTER_BAR, STEP_BAR, Judged, Outcome, Verdict

SHARE_OF_RECORDINGS = 0.995  # on which a filter must agree
SHARE_OF_STEPS = 0.99  # at which causal must be within its bar
VERDICTS: tuple[Verdict, ...] = ("agrees", "worse", "failed", "undecided", "not compared")
UNITS = {"batch": "cost", "batch mapped": "landmarks"}  # of a difference; sigmas if not told


def table(judged: Sequence[Judged]) -> str:
    """A row per estimator: how many recordings of which verdict, and the largest difference that is a number."""
    lines = [f"{'estimator':14}" + "".join(f"{each:>14}" for each in VERDICTS) + f"{'largest difference':>28}"]
    for name, outcomes in by_estimator(judged).items():
        counts = Counter(each.verdict for each in outcomes)
        largest = max((each.difference for each in outcomes if math.isfinite(each.difference)), default=math.nan)
        row = "".join(f"{counts[each]:14d}" for each in VERDICTS)
        lines.append(f"{name:14}{row}{largest:>14.1e} {UNITS.get(name, 'sigma'):13}".rstrip())
    compared, off, unflagged = steps_of(judged)
    if compared:
        lines += ["", f"causal steps: {compared}, more than {STEP_BAR} sigma off: {off} ({off / compared:.2%})"]
        lines[-1] += f", of these in estimates that do not say so: {unflagged}"
    return "\n".join(lines)


def by_estimator(judged: Sequence[Judged]) -> dict[str, list[Outcome]]:
    """The outcomes of each estimator."""
    found: dict[str, list[Outcome]] = {}
    for each in judged:
        for outcome in each.outcomes:
            found.setdefault(outcome.estimator, []).append(outcome)
    return found


def steps_of(judged: Sequence[Judged]) -> tuple[int, int, int]:
    """Steps of causal that were compared, that are off, and that are off in estimates that do not say so."""
    outcomes = by_estimator(judged).get("causal", [])
    return (
        sum(each.steps for each in outcomes),
        sum(each.steps_off for each in outcomes),
        sum(each.unflagged for each in outcomes),
    )


def bars_missed(judged: Sequence[Judged]) -> list[str]:
    """What is not as it has to be, a line each.

    Filters agree with their referee on `SHARE_OF_RECORDINGS`, and iekf ends in its minimum; batch finds the minimum
    wherever the referee finds one, and maps what bearings place; causal is within its bar at `SHARE_OF_STEPS`, and its
    estimate says so where it is not.
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
        missed.append(f"causal: {unflagged} steps off in estimates that do not say so")
    return missed


def _counts(outcomes: Sequence[Outcome]) -> tuple[int, int]:
    """How many agree, and how many do not or failed."""
    counts = Counter(each.verdict for each in outcomes)
    return counts["agrees"], counts["worse"] + counts["failed"]


def messages(judged: Sequence[Judged]) -> list[str]:
    """Each message of an estimator that failed, without its numbers, and how often it came."""
    counts = Counter(
        (outcome.estimator, re.sub(r"\d[\d.]*(e[+-]?\d+)?", "#", outcome.note))
        for each in judged
        for outcome in each.outcomes
        if outcome.verdict == "failed"
    )
    return [f"{count:5d}  {name}: {text}" for (name, text), count in counts.most_common()]


def bad_ones(judged: Judged) -> list[Outcome]:
    """What is worse than its referee, or failed."""
    return [each for each in judged.outcomes if each.verdict in ("worse", "failed")]


def worst_cases(judged: Sequence[Judged], count: int) -> list[tuple[Judged, Outcome]]:
    """Of every estimator at most `count` that are worse, failed or undecided, in this order, the largest first."""
    order: tuple[Verdict, ...] = ("failed", "worse", "undecided")
    found: list[tuple[Judged, Outcome]] = []
    for name in by_estimator(judged):
        rows = [(each, o) for each in judged for o in each.outcomes if o.estimator == name and o.verdict in order]
        rows.sort(key=lambda row: (order.index(row[1].verdict), -row[1].difference))
        found += rows[:count]
    return found


def describe(judged: Judged, outcome: Outcome) -> str:
    """A worst case in two lines."""
    head = f"{outcome.estimator} {outcome.verdict} {outcome.difference:.1e}"
    where = f"--seed {judged.seed} --only {judged.number}: {judged.steps} steps, {', '.join(judged.tags)}"
    return f"{head:36} {where}\n    {outcome.note}"
