"""The conclusions of the exercise as tests: ratios of two figures of the same runs, with intervals and verdicts.

The ratio of a conclusion is the geometric mean over independent runs. Its interval is Student's, of the mean of the
logarithms, at a level that is corrected for the number of ratios of all questions (Bonferroni). A conclusion holds if
its interval is inside the asserted range, does not hold if it is outside, and is undecided otherwise.

Some filters diverge in a few runs only, and an interval of some dozens of runs without such a run is too narrow. The
interval is therefore computed as if two runs more had been seen, with twice and with half the ratio. With it the
probability of any wrong verdict stays below 5 % with 10 to 100 runs (benchmarks/exercise_verdicts.py).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.exercise.settings import CAUSAL, EKF
from slamgauge.compare.scoring.intervals import Interval, half_widths
from slamgauge.compare.scoring.runs import Runs, paired

Verdict = Literal["does not hold", "undecided", "holds"]  # from against to in favour
POWER = 0.9  # probability with which the stated number of runs decides
LIMIT = math.log(100.0)  # largest logarithm of a ratio of a run: a diverged filter counts as a hundred times the error
UNSEEN = np.log([0.5, 2.0])  # logarithms, relative to the mean, of two runs that are added to those of a ratio

MORE, LESS = (1.0, math.inf), (0.0, 1.0)  # ranges of ratios
SAME = (1.0 / 1.1, 1.1)  # "like", "similar"
UNLIKE = (1.1, math.inf)
MUCH = (2.0, math.inf)  # "much", "very", "multiplies"
LARGE = (1.5, math.inf)  # "large" error: at least this factor of the optimum's

HALVES = ("far", "near")  # of the map, from the start
STRETCHES = {"near the start": (0.0, 0.1), "halfway round": (0.45, 0.55), "back at the start": (0.95, 1.05)}  # loops


def figures_of(runs: Runs) -> dict[str, Float]:
    """Return figures (R,) of every run, by the names that conclusions use."""
    stored = runs.figures
    found = {
        "ATE": stored["ate_m"],
        f"ATE of {CAUSAL}": stored["ate_m"],  # the other figures are those of the EKF
        "reported sigma": runs.reported_sigma(),
        "mapped landmarks": stored["landmarks_mapped"],
        "true landmarks": stored["landmarks_true"],
        "landmarks found": np.maximum(stored["landmarks_true"] - stored["landmarks_missed"], 0.5),  # for logarithms
    }
    for what in ("error", "sigma"):
        squares = runs.squares(f"{what}_x", f"{what}_y")
        for half in HALVES:
            found[f"{what} of the {half} half of the map"] = stored[f"map_halves_{what}_{half}_m"]
        for stretch, shares in STRETCHES.items():
            first, last = (round(share * (squares.shape[1] - 1) / 2) for share in shares)
            sums = squares[:, first : last + 1].sum(axis=1)
            found[f"position {what} {stretch}"] = np.sqrt(sums / (last + 1 - first))
    return found


class Measure(NamedTuple):
    """A figure of every run: its name in `figures_of`, and the number of the setting."""

    name: str
    setting: str


class Conclusion(NamedTuple):
    """A conclusion of the exercise: the first measure over each other one is in the range `asserted`, ends excluded.

    `id` begins with the question; `text` is the conclusion of the exercise, shortened.
    """

    id: str
    text: str
    asserted: tuple[float, float]
    measures: tuple[Measure, ...]

    @property
    def hypothesis(self) -> str:
        """The conclusion as a statement about a ratio."""
        low, high = self.asserted
        above, *below = (f"{each.name} ({each.setting})" for each in self.measures)
        where = f"< {high:g}" if low == 0.0 else f"> {low:g}"
        if 0.0 < low < high < math.inf:
            where = f"within 1/{high:g} and {high:g}"
        return f"{above} / {', / '.join(below)} {where}"


def _claim(id: str, text: str, asserted: tuple[float, float], settings: Sequence[str], *names: str) -> Conclusion:
    return Conclusion(id, text, asserted, tuple(Measure(name, each) for name in names for each in settings))


START, HALF, BACK = STRETCHES
ERROR, SIGMA = ({each: f"position {what} {each}" for each in STRETCHES} for what in ("error", "sigma"))
MAP_ERROR, MAP_SIGMA = ([f"{what} of the {half} half of the map" for half in HALVES] for what in ("error", "sigma"))
MAPPED, FOUND = ("mapped landmarks", "true landmarks"), ("landmarks found", "true landmarks")
GATE = "with gate 9 the {} map looks as with known association"
CONCLUSIONS = (
    _claim(
        "q1-near-landmarks-error",
        "landmarks near the start are better localised than far ones",
        MORE,
        ["2.2"],
        *MAP_ERROR,
    ),
    _claim("q1-near-landmarks-sigma", "their uncertainty is smaller", MORE, ["2.2"], *MAP_SIGMA),
    _claim("q1-error-grows", "the error accumulates along the loop", MORE, ["2.2"], ERROR[HALF], ERROR[START]),
    _claim("q1-sigma-grows", "so does the uncertainty", MORE, ["2.2"], SIGMA[HALF], SIGMA[START]),
    _claim("q1-error-falls", "the error is corrected at the start point", LESS, ["2.2"], ERROR[BACK], ERROR[HALF]),
    _claim("q1-sigma-falls", "so is the uncertainty", LESS, ["2.2"], SIGMA[BACK], SIGMA[HALF]),
    _claim("q1-sparse-error", "on the sparse map the error is big", MUCH, ["2.3", "2.2"], "ATE"),
    _claim(
        "q2-gate-1-landmarks", "a gate that is too small maps more landmarks than there are", MORE, ["2.4"], *MAPPED
    ),
    _claim("q2-gate-100-landmarks", "a gate that is too large ignores some landmarks", LESS, ["2.5"], *FOUND),
    _claim("q2-gate-100-error", "and multiplies the error", MUCH, ["2.5", "2.7"], "ATE"),
    _claim("q2-like-known-short-dense", GATE.format("short, dense"), SAME, ["2.6", "2.1"], "ATE"),
    _claim("q2-like-known-long-dense", GATE.format("long, dense"), SAME, ["2.7", "2.2"], "ATE"),
    _claim("q2-unlike-known-sparse", "with too few landmarks it does not", UNLIKE, ["2.8", "2.3"], "ATE"),
    _claim("q3-scale-0.1-landmarks", "with Q and Py too small, landmarks are misidentified", MORE, ["3.1"], *MAPPED),
    _claim("q3-scale-0.1-error", "and the error is really big", LARGE, ["3.1"], "ATE", f"ATE of {CAUSAL}"),
    _claim("q3-scale-1-error", "with the true noise the error is smaller", LESS, ["3.2", "3.1"], "ATE"),
    _claim("q3-scale-10-error", "with ten times the noise it is smaller still", LESS, ["3.3", "3.2"], "ATE"),
    _claim("q3-scale-10-sigma", "but the uncertainty is very big", MUCH, ["3.3", "3.2"], "reported sigma"),
    _claim("q3-scale-2-best", "the best choice is twice the noise", LESS, ["3.4", "3.1", "3.2", "3.3"], "ATE"),
)
RATIOS = sum(len(each.measures) - 1 for each in CONCLUSIONS)
LEVEL = 1.0 - 0.05 / RATIOS  # of each interval: with a probability of 95 % all together contain the true ratios


@dataclass(frozen=True)
class Judgement:
    """Verdict on a conclusion, or on one of its ratios, and the ratio, None without runs.

    `runs_needed` runs would decide it with a probability of 90 %, if they scatter as these do; None if the
    conclusion is decided, or if the ratio is at an end of the asserted range.
    """

    verdict: Verdict
    ratio: Interval | None = None  # geometric mean over runs; its interval holds for all conclusions together
    runs: int = 0  # number of runs with both figures
    runs_needed: int | None = None
    margin: float = -math.inf  # of the ratio's logarithm in the asserted range, from the nearest end; negative outside


def judge(conclusion: Conclusion, runs: Mapping[str, Mapping[str, Runs]]) -> Judgement:
    """Judge a conclusion; `runs` are by number of the setting and by estimator.

    Of several ratios, the one that is least in favour of the conclusion decides.
    """
    above, *below = conclusion.measures
    judged = [judge_ratio(log_ratios(above, each, runs), conclusion.asserted) for each in below]
    return min(judged, key=lambda found: (get_args(Verdict).index(found.verdict), found.margin))


def log_ratios(above: Measure, below: Measure, runs: Mapping[str, Mapping[str, Runs]]) -> Float:
    """Return the logarithms (R,), at most LIMIT, of a ratio in the runs that have both figures."""
    ours, theirs = (runs[each.setting][CAUSAL if CAUSAL in each.name else EKF] for each in (above, below))
    rows, others = paired(ours, theirs)
    high, low = figures_of(ours)[above.name][rows], figures_of(theirs)[below.name][others]
    known = (high > 0.0) & (low > 0.0)  # False for NaN
    return np.log(high[known] / low[known]).clip(-LIMIT, LIMIT)


def judge_ratio(logarithms: Float, asserted: tuple[float, float]) -> Judgement:
    """Judge whether a ratio is in the asserted range, ends excluded, from its logarithms (R,) in independent runs."""
    runs = len(logarithms)
    if not runs:
        return Judgement("undecided")
    mean = float(logarithms.mean())
    low, high = np.log(np.maximum(asserted, np.finfo(float).tiny)).tolist()
    margin = min(mean - low, high - mean)
    half = float(half_widths(np.append(logarithms, mean + UNSEEN), LEVEL))
    ratio = Interval(*(math.exp(each) for each in (mean, mean - half, mean + half)))
    if abs(margin) > half:
        return Judgement("holds" if margin > 0.0 else "does not hold", ratio, runs, margin=margin)
    return Judgement("undecided", ratio, runs, _runs_needed(logarithms, abs(margin)), margin)


def _runs_needed(logarithms: Float, distance: float) -> int | None:
    """Return the runs, to two digits, after which an interval ends before an end of the range at this distance.

    With n runs and the two of UNSEEN the standard error is the root of (n scatter^2 + 2 log(2)^2) / (n + 2)^2.
    """
    from scipy.special import ndtri  # here: scipy is slow to start

    if len(logarithms) < 2 or distance <= 0.0:
        return None
    variance = float(logarithms.var(ddof=1))
    factor = ((float(ndtri((1.0 + LEVEL) / 2.0)) + float(ndtri(POWER))) / distance) ** 2
    linear, constant = factor * variance, 2.0 * factor * (math.log(2.0) ** 2 - variance)
    runs = (linear + math.sqrt(max(linear**2 + 4.0 * constant, 0.0))) / 2.0 - 2.0
    step = 10 ** max(0, math.floor(math.log10(max(runs, 1.0))) - 1)
    return math.ceil(runs / step) * step
