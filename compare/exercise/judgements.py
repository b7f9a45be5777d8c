"""Judgements of the exercise's conclusions: ratios with intervals, and verdicts.

The exercise answers its questions from single runs. Here the ratio of a conclusion is the geometric mean, over
independent runs, of the ratio of two figures of the same run. Its interval is Student's, of the mean of the logarithms.
The level is corrected for the number of ratios of all questions (Bonferroni), so that with a probability of 95 % all
intervals together contain the true ratios. A conclusion holds if its interval is inside the asserted range, does not
hold if it is outside, and is undecided otherwise.

Some filters diverge in a few runs only, and an interval of some dozens of runs without such a run is too narrow. The
interval is therefore computed as if two runs more had been seen, with twice and with half the ratio. With it the
probability of any wrong verdict stays below 5 % with 10 to 100 runs (benchmarks/exercise_verdicts.py).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Literal, NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.exercise.conclusions import CONCLUSIONS, Conclusion, Measure
from slamgauge.compare.scoring.intervals import Interval, mean_interval
from slamgauge.compare.scoring.runs import Runs, paired

Verdict = Literal["holds", "does not hold", "undecided"]
ERROR = 0.05  # largest probability that any of the intervals misses its ratio
POWER = 0.9  # probability with which the stated number of runs decides
LIMIT = math.log(100.0)  # largest logarithm of a ratio of a run: a diverged filter counts as a hundred times the error
STRENGTH: tuple[Verdict, ...] = ("does not hold", "undecided", "holds")  # verdicts from against to in favour
UNSEEN = np.log([0.5, 2.0])  # logarithms, relative to the mean, of two runs that are added to those of a ratio
RATIOS = sum(len(each.below) for each in CONCLUSIONS)


class Judgement(NamedTuple):
    """Verdict on a conclusion, or on one of its ratios.

    Attributes:
        verdict: `holds`, `does not hold` or `undecided`.
        ratio: geometric mean over runs with its interval, which holds for all conclusions together; None without runs.
        runs: number of runs with both figures.
        runs_needed: number of runs that would decide it with a probability of 90 %, if they scatter as these do; None
            if it is decided, or if the ratio is at an end of the asserted range.
    """

    verdict: Verdict
    ratio: Interval | None
    runs: int
    runs_needed: int | None


def judge(conclusion: Conclusion, runs: Mapping[tuple[str, str], Runs]) -> Judgement:
    """Judge a conclusion; `runs` are by number of the setting and estimator.

    Of several ratios, the one that is least in favour of the conclusion decides.
    """
    every = [log_ratios(conclusion.above, each, runs) for each in conclusion.below]
    judged = [(judge_ratio(each, conclusion.asserted), _margin(each, conclusion.asserted)) for each in every]
    return min(judged, key=lambda found: (STRENGTH.index(found[0].verdict), found[1]))[0]


def log_ratios(above: Measure, below: Measure, runs: Mapping[tuple[str, str], Runs]) -> Float:
    """Return the logarithms (R,), at most LIMIT, of a ratio in the runs that have both figures."""
    ours, theirs = runs[above.figure, above.estimator], runs[below.figure, below.estimator]
    rows, others = paired(ours, theirs)
    figures = above.read(ours)[rows], below.read(theirs)[others]
    known = (figures[0] > 0.0) & (figures[1] > 0.0)  # False for NaN
    return np.log(figures[0][known] / figures[1][known]).clip(-LIMIT, LIMIT)


def judge_ratio(logarithms: Float, asserted: tuple[float, float], tests: int = RATIOS) -> Judgement:
    """Judge whether a ratio is in the asserted range.

    Args:
        logarithms: (R,) logarithms of the ratio in independent runs.
        asserted: range of the ratio, both ends excluded.
        tests: number of ratios that are judged together.
    """
    runs, level = len(logarithms), 1.0 - ERROR / tests
    if not runs:
        return Judgement("undecided", None, 0, None)
    interval = mean_interval(np.append(logarithms, logarithms.mean() + UNSEEN), level)
    assert interval is not None and interval.low is not None and interval.high is not None
    low, high = np.log(np.maximum(asserted, np.finfo(float).tiny))
    verdict: Verdict = "undecided"
    if low < interval.low and interval.high < high:
        verdict = "holds"
    elif interval.high < low or high < interval.low:
        verdict = "does not hold"
    ratio = Interval(*(math.exp(each) for each in (interval.mean, interval.low, interval.high)))
    needed = None
    if verdict == "undecided" and runs > 1:
        needed = _runs_needed(float(logarithms.std(ddof=1)), abs(_margin(logarithms, asserted)), level)
    return Judgement(verdict, ratio, runs, needed)


def _margin(logarithms: Float, asserted: tuple[float, float]) -> float:
    """Return how far the mean logarithm is inside the asserted range, from the nearest end; it is negative outside."""
    ends = [(math.log(end), sign) for end, sign in zip(asserted, (1.0, -1.0), strict=True) if 0.0 < end < math.inf]
    return min(sign * (float(logarithms.mean()) - end) for end, sign in ends) if len(logarithms) else -math.inf


def _runs_needed(scatter: float, distance: float, level: float) -> int | None:
    """Return the runs, to two digits, after which an interval ends before an end of the range at this distance.

    With n runs and the two of UNSEEN the standard error is the root of (n scatter^2 + 2 log(2)^2) / (n + 2)^2.
    """
    from scipy.special import ndtri  # here: scipy is slow to start

    if distance <= 0.0:
        return None
    factor = ((float(ndtri((1.0 + level) / 2.0)) + float(ndtri(POWER))) / distance) ** 2
    linear, constant = factor * scatter**2, 2.0 * factor * (math.log(2.0) ** 2 - scatter**2)
    runs = (linear + math.sqrt(max(linear**2 + 4.0 * constant, 0.0))) / 2.0 - 2.0
    step = 10 ** max(0, math.floor(math.log10(max(runs, 1.0))) - 1)
    return math.ceil(runs / step) * step


def to_json(conclusion: Conclusion, judgement: Judgement) -> dict[str, Any]:
    """Return the entry of a conclusion in exercise.json."""
    low, high = conclusion.asserted
    return {
        **{key: getattr(conclusion, key) for key in ("id", "text", "hypothesis")},
        "asserted": [low, None if high == math.inf else high],
        **judgement._asdict(),
        "ratio": None if judgement.ratio is None else asdict(judgement.ratio),
    }
