"""The conclusions of the exercise as ratios of two figures of the same runs, each with an interval and a verdict.

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
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.exercise.settings import CAUSAL, EKF
from slamgauge.compare.scoring.aggregation import reported_sigma
from slamgauge.compare.scoring.intervals import Interval, mean_interval
from slamgauge.compare.scoring.runs import Runs, paired

Verdict = Literal["holds", "does not hold", "undecided"]
ERROR = 0.05  # largest probability that any of the intervals misses its ratio
POWER = 0.9  # probability with which the stated number of runs decides
LIMIT = math.log(100.0)  # of the logarithm of a ratio of a run: a diverged filter counts as a hundred times the error
STRENGTH: tuple[Verdict, ...] = ("does not hold", "undecided", "holds")  # verdicts from against to in favour
# ranges of ratios
MORE, LESS = (1.0, math.inf), (0.0, 1.0)
UNSEEN = np.log([0.5, 2.0])  # logarithms, relative to the mean, of two runs that are added to those of a ratio
SAME = (1.0 / 1.1, 1.1)  # "like", "similar"
MUCH = (2.0, math.inf)  # "much", "very", "multiplies"
LARGE = (1.5, math.inf)  # "large" error: at least this factor of the optimum's
STRETCHES = {"near the start": (0.0, 0.1), "halfway round": (0.45, 0.55), "back at the start": (0.95, 1.05)}  # loops


class Measure(NamedTuple):
    """A figure (R,) of every run: number of the setting, name, function that reads it from the runs, and estimator."""

    figure: str
    name: str
    read: Callable[[Runs], Float]
    estimator: str = EKF

    def __str__(self) -> str:
        return f"{self.name} ({self.figure})"


@dataclass(frozen=True)
class Conclusion:
    """A conclusion of the exercise: `above` divided by each of `below` is in the range `asserted`.

    Attributes:
        id: short name; it begins with the question.
        text: the conclusion of the exercise, shortened.
        above: numerator.
        below: denominators; the conclusion must hold for each.
        asserted: range of the ratio, both ends excluded.
    """

    id: str
    text: str
    above: Measure
    below: tuple[Measure, ...]
    asserted: tuple[float, float]

    @property
    def question(self) -> str:
        """`q1`, `q2` or `q3`."""
        return self.id.partition("-")[0]

    @property
    def hypothesis(self) -> str:
        """The conclusion as a statement about a ratio."""
        low, high = self.asserted
        if low == 0.0:
            where = f"< {high:g}"
        elif high == math.inf:
            where = f"> {low:g}"
        else:
            where = f"within 1/{high:g} and {high:g}"
        return f"{self.above} / {', / '.join(map(str, self.below))} {where}"


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


def stored(figure: str, key: str, name: str) -> Measure:
    """Return a figure that studies store, by its key in `scoring.catalogue`."""
    return Measure(figure, name, lambda runs: runs.figures[key])


def ate(figure: str, estimator: str = EKF) -> Measure:
    """Return the RMS position error over the path [m]."""
    name = "ATE" if estimator == EKF else f"ATE of {estimator}"
    return Measure(figure, name, lambda runs: runs.figures["ate_m"], estimator)


def landmarks_found(figure: str) -> Measure:
    """Return the number of true landmarks that are mapped; 0.5 for none, because ratios have logarithms."""

    def read(runs: Runs) -> Float:
        return np.maximum(runs.figures["landmarks_true"] - runs.figures["landmarks_missed"], 0.5)

    return Measure(figure, "landmarks found", read)


def landmarks(figure: str, key: Literal["mapped", "true"]) -> Measure:
    """Return the number of landmarks that are mapped, or that were observed."""
    return stored(figure, f"landmarks_{key}", f"{key} landmarks")


def reported(figure: str) -> Measure:
    """Return the RMS position sigma over the path [m]."""
    return Measure(figure, "reported sigma", reported_sigma)


def half_map(what: Literal["error", "sigma"], half: Literal["near", "far"]) -> Measure:
    """Return RMS error or sigma [m] of the half of the map that is nearer to the start, or of the farther one."""
    return stored("2.2", f"landmark_{what}_{half}_m", f"{what} of the {half} half of the map")


def during(what: Literal["error", "sigma"], stretch: str) -> Measure:
    """Return RMS position error or sigma [m] in a stretch of the first of two loops."""

    def read(runs: Runs) -> Float:
        squares = runs.series[f"{what}_x"] ** 2 + runs.series[f"{what}_y"] ** 2
        first, last = (round(share * (squares.shape[1] - 1) / 2) for share in STRETCHES[stretch])
        return np.sqrt(squares[:, first : last + 1].mean(axis=1))

    return Measure("2.2", f"position {what} {stretch}", read)


CONCLUSIONS = (
    Conclusion(
        "q1-near-landmarks-error",
        "landmarks near the start are better localised than far ones",
        half_map("error", "far"),
        (half_map("error", "near"),),
        MORE,
    ),
    Conclusion(
        "q1-near-landmarks-sigma",
        "their uncertainty is smaller",
        half_map("sigma", "far"),
        (half_map("sigma", "near"),),
        MORE,
    ),
    Conclusion(
        "q1-error-grows",
        "the error accumulates along the loop",
        during("error", "halfway round"),
        (during("error", "near the start"),),
        MORE,
    ),
    Conclusion(
        "q1-sigma-grows",
        "so does the uncertainty",
        during("sigma", "halfway round"),
        (during("sigma", "near the start"),),
        MORE,
    ),
    Conclusion(
        "q1-error-falls",
        "the error is corrected at the start point",
        during("error", "back at the start"),
        (during("error", "halfway round"),),
        LESS,
    ),
    Conclusion(
        "q1-sigma-falls",
        "so is the uncertainty",
        during("sigma", "back at the start"),
        (during("sigma", "halfway round"),),
        LESS,
    ),
    Conclusion("q1-sparse-error", "on the sparse map the error is big", ate("2.3"), (ate("2.2"),), MUCH),
    Conclusion(
        "q2-gate-1-landmarks",
        "a gate that is too small maps more landmarks than there are",
        landmarks("2.4", "mapped"),
        (landmarks("2.4", "true"),),
        MORE,
    ),
    Conclusion(
        "q2-gate-100-landmarks",
        "a gate that is too large ignores some landmarks",
        landmarks_found("2.5"),
        (landmarks("2.5", "true"),),
        LESS,
    ),
    Conclusion("q2-gate-100-error", "and multiplies the error", ate("2.5"), (ate("2.7"),), MUCH),
    Conclusion(
        "q2-like-known-short-dense",
        "with gate 9 the short, dense map looks as with known association",
        ate("2.6"),
        (ate("2.1"),),
        SAME,
    ),
    Conclusion(
        "q2-like-known-long-dense",
        "with gate 9 the long, dense map looks as with known association",
        ate("2.7"),
        (ate("2.2"),),
        SAME,
    ),
    Conclusion(
        "q2-unlike-known-sparse", "with too few landmarks it does not", ate("2.8"), (ate("2.3"),), (SAME[1], math.inf)
    ),
    Conclusion(
        "q3-scale-0.1-landmarks",
        "with Q and Py too small, landmarks are misidentified",
        landmarks("3.1", "mapped"),
        (landmarks("3.1", "true"),),
        MORE,
    ),
    Conclusion("q3-scale-0.1-error", "and the error is really big", ate("3.1"), (ate("3.1", CAUSAL),), LARGE),
    Conclusion("q3-scale-1-error", "with the true noise the error is smaller", ate("3.2"), (ate("3.1"),), LESS),
    Conclusion("q3-scale-10-error", "with ten times the noise it is smaller still", ate("3.3"), (ate("3.2"),), LESS),
    Conclusion("q3-scale-10-sigma", "but the uncertainty is very big", reported("3.3"), (reported("3.2"),), MUCH),
    Conclusion(
        "q3-scale-2-best",
        "the best choice is twice the noise",
        ate("3.4"),
        (ate("3.1"), ate("3.2"), ate("3.3")),
        LESS,
    ),
)
RATIOS = sum(len(each.below) for each in CONCLUSIONS)


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
