"""Conclusions: ratios of figures of the same runs, intervals that hold together, and verdicts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy import stats

from slamgauge.arrays import Float
from slamgauge.compare.exercise.conclusions import (
    CONCLUSIONS,
    LESS,
    LEVEL,
    MORE,
    MUCH,
    POWER,
    RATIOS,
    SAME,
    UNSEEN,
    Conclusion,
    Judgement,
    Measure,
    figures_of,
    judge,
    judge_ratio,
    log_ratios,
)
from slamgauge.compare.exercise.settings import EKF, SETTINGS
from slamgauge.compare.scoring.catalogue import STORED
from slamgauge.compare.scoring.runs import SERIES, Runs


def sample(mean: float, spread: float, runs: int = 50) -> Float:
    """Return figures with exactly this mean and standard deviation."""
    drawn = np.random.default_rng(0).normal(size=runs)
    return mean + spread * (drawn - drawn.mean()) / drawn.std(ddof=1)


def runs_of(ates: Float, numbers: list[int] | None = None) -> Runs:
    numbers = [*range(len(ates))] if numbers is None else numbers
    figures = dict.fromkeys(STORED, np.asarray(ates, dtype=np.float64))
    return Runs(np.array(numbers), "filtered", figures, dict.fromkeys(SERIES, np.ones((len(ates), 600))))


def test_the_interval_is_students_of_the_logarithms_and_two_runs_more_at_a_level_corrected_for_all_ratios():
    logs = np.random.default_rng(1).normal(0.1, 0.3, 40)
    found = judge_ratio(logs, MORE).ratio
    expected = stats.ttest_1samp([*logs, *(logs.mean() + UNSEEN)], 0.0).confidence_interval(LEVEL)
    assert found is not None
    assert (found.low, found.high) == pytest.approx((math.exp(expected.low), math.exp(expected.high)))
    assert found.mean == pytest.approx(math.exp(logs.mean()))
    assert RATIOS == 21
    assert pytest.approx(1 - 0.05 / 21) == LEVEL


@pytest.mark.parametrize(
    ("logs", "asserted", "verdict"),
    [
        (sample(0.3, 0.1), MORE, "holds"),
        (sample(0.02, 0.1), MORE, "undecided"),
        (sample(-0.3, 0.1), LESS, "holds"),
        (sample(math.log(1.9), 0.5), MUCH, "undecided"),
        (sample(0.0, 0.1), SAME, "holds"),
        (sample(0.2, 0.1), SAME, "does not hold"),
        (sample(0.0, 0.5), SAME, "undecided"),  # a difference that is not significant is not likeness
        (np.zeros(0), MORE, "undecided"),
        (np.ones(1), MORE, "undecided"),
    ],
)
def test_a_verdict_needs_the_whole_interval(logs: Float, asserted: tuple[float, float], verdict: str):
    found = judge_ratio(logs, asserted)
    assert (found.verdict, found.runs) == (verdict, len(logs))
    assert (found.runs_needed is None) == (verdict != "undecided" or len(logs) < 2)


STUDIES = 8000


def wrong_share(logs: Float) -> float:
    """Return the share of studies (STUDIES, runs) with a verdict, where the true ratio is an end of the range."""
    return sum(judge_ratio(each, MORE).verdict != "undecided" for each in logs) / len(logs)


@pytest.mark.parametrize("runs", [10, 20, 100])
@pytest.mark.parametrize(("spread", "lowest"), [(0.7, 0.0010), (0.3, 0.0)], ids=["wide", "narrow"])
def test_false_verdicts_are_as_rare_as_stated(spread: float, lowest: float, runs: int):
    """1 - LEVEL = 0.24 % of the studies may end with a verdict, within four standard deviations.

    If the ratios scatter less than the two added runs, false verdicts are rarer.
    """
    assert lowest <= wrong_share(np.random.default_rng(3).normal(0.0, spread, (STUDIES, runs))) <= 0.0044


@pytest.mark.parametrize("runs", [10, 20, 100])
def test_runs_that_seldom_diverge_cause_few_false_verdicts(runs: int):
    """One run in 25 has e times the ratio: at most 2 % of the studies are wrong, over 20 % with Student alone."""
    rng = np.random.default_rng(3)
    diverged = rng.random((STUDIES, runs)) < 0.04
    logs = rng.normal(0.0, 0.05, (STUDIES, runs)) + diverged - 0.04
    assert wrong_share(logs) <= 0.02
    if runs == 20:
        alone = stats.ttest_1samp(logs, 0.0, axis=1).pvalue < 1 - LEVEL
        assert alone.mean() > 0.2


def test_twice_the_runs_needed_decide_as_often_as_stated():
    """The stated number decides with probability POWER: of 2000 studies, within four standard deviations."""
    rng, studies, mean, spread = np.random.default_rng(4), 2000, 0.1, 0.3
    first = judge_ratio(sample(mean, spread, 20), MORE)
    needed = first.runs_needed
    assert first.verdict == "undecided" and needed is not None
    holds = sum(judge_ratio(each, MORE).verdict == "holds" for each in rng.normal(mean, spread, (studies, needed)))
    assert abs(holds / studies - POWER) <= 0.015 + 4.0 * math.sqrt(POWER * (1 - POWER) / studies)  # 0.015: two digits


@pytest.mark.parametrize(
    ("above", "below", "ratios"),
    [
        (([8.0, 6.0, 5.0, 1e9], [1, 2, 3, 5]), ([1.0, 2.0, 3.0, np.nan, 0.0], [0, 1, 2, 3, 4]), [4.0, 2.0]),
        (([1e6, 1e-6], [0, 1]), ([1.0, 1.0], [0, 1]), [100.0, 0.01]),  # a diverged run counts as a hundred
    ],
)
def test_a_ratio_uses_the_runs_that_have_both_figures(above: Any, below: Any, ratios: list[float]):
    runs = {"2.6": {EKF: runs_of(*above)}, "2.1": {EKF: runs_of(*below)}}
    np.testing.assert_allclose(log_ratios(Measure("ATE", "2.6"), Measure("ATE", "2.1"), runs), np.log(ratios))


def judged(ratios: dict[str, Float]) -> Judgement:
    """Judge that an error is smaller than several others, from the logarithms of the ratios."""
    runs = {name: {EKF: runs_of(np.exp(-each))} for name, each in (ratios | {"3.4": np.zeros(50)}).items()}
    return judge(Conclusion("q3-x", "", LESS, tuple(Measure("ATE", name) for name in ("3.4", *ratios))), runs)


def test_a_conclusion_with_several_ratios_must_hold_for_each():
    low, near, high = sample(-0.5, 0.1), sample(-0.2, 0.1), sample(0.2, 0.1)
    unclear = sample(-0.01, 0.1)
    assert judged({"3.1": low, "3.2": near}).verdict == "holds"
    assert judged({"3.1": low, "3.2": near}).ratio == judged({"3.2": near}).ratio  # the least favourable
    assert judged({"3.1": low, "3.2": unclear}).verdict == "undecided"
    assert judged({"3.1": unclear, "3.2": high, "3.3": low}).verdict == "does not hold"


@pytest.mark.parametrize(
    ("stretch", "first", "last"), [("near the start", 0, 5), ("halfway round", 22, 28), ("back at the start", 48, 52)]
)
def test_stretches_are_shares_of_the_first_of_two_loops(stretch: str, first: int, last: int):
    runs = runs_of(np.zeros(1))
    runs.series.update(error_x=np.arange(101.0)[None], error_y=np.zeros((1, 101)))
    (found,) = figures_of(runs)[f"position error {stretch}"]
    assert found == pytest.approx(math.sqrt(np.mean(np.arange(first, last + 1) ** 2)))


def test_conclusions_name_settings_of_the_exercise_and_figures_that_studies_store():
    """A metric that left the catalogue ended `slamgauge exercise` in a KeyError after all runs."""
    figures = figures_of(runs_of(np.ones(3)))
    assert len({each.id for each in CONCLUSIONS}) == len(CONCLUSIONS) == 19
    for each in CONCLUSIONS:
        assert SETTINGS[each.measures[0].setting].question == each.id[:2]
        assert all(measure.setting in SETTINGS for measure in each.measures)
        assert all(figures[measure.name].shape == (3,) for measure in each.measures)
    hypotheses = {each.id: each.hypothesis for each in CONCLUSIONS}
    assert hypotheses["q1-sparse-error"] == "ATE (2.3) / ATE (2.2) > 2"
    assert hypotheses["q2-like-known-long-dense"] == "ATE (2.7) / ATE (2.2) within 1/1.1 and 1.1"
    assert hypotheses["q3-scale-2-best"] == "ATE (3.4) / ATE (3.1), / ATE (3.2), / ATE (3.3) < 1"
