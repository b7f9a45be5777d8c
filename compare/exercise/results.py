"""Results of the exercise: figures of each setting, loop closures, and the answer to each question in a sentence."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from slamgauge.arrays import Int
from slamgauge.compare.exercise.conclusions import Conclusion
from slamgauge.compare.exercise.judgements import Judgement
from slamgauge.compare.exercise.judgements import to_json as conclusion_json
from slamgauge.compare.exercise.settings import CAUSAL, EKF, GTSAM, QUESTIONS, Setting
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scoring.intervals import mean, rms
from slamgauge.compare.scoring.optimum_notes import doubt_in_runs
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.scoring.table import interval_cell
from slamgauge.compare.storage.result_files import origin
from slamgauge.compare.studies.summary import EstimatorSummary, summarise

AT_CLOSURES = (EKF, CAUSAL, GTSAM)  # estimators whose errors at loop closures are shown
SMALL_FALL = 0.9  # error after a loop closure over that before: a correction by less than a tenth does not count


@dataclass(frozen=True)
class AtClosure:
    """RMS over runs of the position error, and three times that of the position sigma, just before and at a step."""

    error_before_m: float | None
    error_after_m: float | None
    three_sigma_before_m: float | None
    three_sigma_after_m: float | None


@dataclass(frozen=True)
class Closure:
    """The first loop closure of a lap: mean time [s] over `runs` runs with one, and the estimators at that step."""

    lap: int
    time_s: float
    runs: int
    estimators: dict[str, AtClosure]


@dataclass(frozen=True)
class SettingResult:
    """Runs of a setting, and their figures.

    `runs` are the stored runs by name of the estimator, `first_closures` (R, laps) the step of the first loop closure
    in each lap of each run; -1 without one.
    """

    setting: Setting
    scenario: Scenario
    runs: dict[str, Runs]
    first_closures: Int

    @cached_property
    def estimators(self) -> dict[str, EstimatorSummary]:
        """Summary of each estimator, as in summary.json."""
        return summarise(self.runs)

    @cached_property
    def landmarks_true(self) -> float | None:
        """Mean number of distinct landmarks that were observed."""
        return mean(self.runs[EKF].figures["landmarks_true"])

    @cached_property
    def closures(self) -> list[Closure]:
        """The first loop closure of each lap that has one."""
        laps = enumerate(self.first_closures.T, 1)
        return [self._closure(lap, steps) for lap, steps in laps if (steps >= 0).any()]

    def _closure(self, lap: int, steps: Int) -> Closure:
        known = steps[steps >= 0]
        time = float(known.mean()) * self.scenario.trajectory.step
        return Closure(lap, time, len(known), {name: _at(self.runs[name], steps) for name in AT_CLOSURES})

    @property
    def ekf(self) -> EstimatorSummary:
        """Summary of the EKF."""
        return self.estimators[EKF]

    @property
    def consistency(self) -> str:
        """`consistent`, `overconfident` or `cautious`, as far as the runs show; `-` without a NEES."""
        if self.ekf["nees_pose_per_dof"] is None:
            return "-"
        if not any("a sigma" in fault for fault in self.ekf["faults"]):
            return "consistent"
        return "overconfident" if self.ekf["nees_pose_per_dof"].mean > 1.0 else "cautious"

    @property
    def doubt(self) -> str | None:
        """Return that the causal optimum, the reference of the ratio, is in doubt in some runs; None if it is not."""
        return doubt_in_runs(f"{self.setting.figure}: {CAUSAL}", self.estimators[CAUSAL]["optimum_check_share"])

    def to_json(self) -> dict[str, Any]:
        """Return the entry of the setting in exercise.json."""
        return {
            "figure": self.setting.figure,
            "scenario": self.setting.scenario,
            "title": self.setting.title,
            "consistency": self.consistency,
            "landmarks_true": self.landmarks_true,
            "estimators": {name: each.to_json() for name, each in self.estimators.items()},
            "loop_closures": [asdict(each) for each in self.closures],
        }


@dataclass(frozen=True)
class QuestionResult:
    """Results of a question: its settings, and the judgements of its conclusions."""

    name: str
    settings: list[SettingResult]
    judgements: list[tuple[Conclusion, Judgement]]

    def answer(self) -> str:
        """Return in a sentence how accurate and consistent the EKF is, and how many conclusions hold."""
        parts = (self._accuracy(), self._consistency(), self._verdicts())
        return f"{'; '.join(filter(None, parts))}."

    def _accuracy(self) -> str:
        ratios = [(each.setting, each.ekf["ratio_to_causal"]) for each in self.settings]
        known = sorted(((setting, ratio) for setting, ratio in ratios if ratio), key=lambda pair: pair[1].mean)
        if not known:
            return "no run has both the EKF and the causal optimum"
        (best, least), (worst, most) = known[0], known[-1]
        text = f"the error of the EKF is {interval_cell(least, '{:.2f}')} ({best.figure}, {best.title})"
        text += f" to {interval_cell(most, '{:.2f}')} ({worst.figure}, {worst.title})" if len(known) > 1 else ""
        return f"{text} times that of the causal optimum"

    def _consistency(self) -> str:
        found: dict[str, list[str]] = {}
        for each in self.settings:
            if each.ekf["nees_pose_per_dof"] is not None:
                found.setdefault(each.consistency, []).append(each.setting.figure)
        parts = [f"{word} in {_listed(places)}" for word, places in found.items()]
        return f"it is {_listed(parts)}" if parts else ""

    def _verdicts(self) -> str:
        if not self.judgements:
            return ""
        counts = Counter(judgement.verdict for _, judgement in self.judgements)
        words = {"holds": ("holds", "hold"), "does not hold": ("does not hold", "do not hold")}
        parts = [
            f"{count} {words.get(verdict, ('is undecided', 'are undecided'))[count > 1]}"
            for verdict, count in counts.most_common()
        ]
        return f"of the exercise's {len(self.judgements)} conclusions {_listed(parts)}"

    def largest_correction(self) -> str:
        """Return the loop closure with the largest relative decrease of the EKF's error; empty without closures."""
        every = [(each.setting, closure, closure.estimators) for each in self.settings for closure in each.closures]
        known = [row for row in every if row[2][EKF].error_before_m and row[2][CAUSAL].error_before_m]
        if not known:
            return ""
        setting, closure, found = min(known, key=lambda row: _fall(row[2][EKF]))
        if _fall(found[EKF]) > SMALL_FALL:
            return "No first loop closure of a lap corrects the error of the EKF by more than a tenth."
        return (
            f"The largest correction by a loop closure is in {setting.figure} ({setting.title}), lap {closure.lap}: "
            f"the error of the EKF goes from {_before_and_after(found[EKF])}, that of the causal optimum from "
            f"{_before_and_after(found[CAUSAL])}."
        )

    def to_json(self) -> dict[str, Any]:
        """Return the entry of the question in exercise.json."""
        question = QUESTIONS[self.name]
        return {
            "title": question.title,
            "task": question.task,
            "answer": self.answer(),
            "largest_correction": self.largest_correction(),
            "settings": [each.to_json() for each in self.settings],
            "conclusions": [conclusion_json(*pair) for pair in self.judgements],
        }


@dataclass(frozen=True)
class Exercise:
    """Results of questions over `runs` runs of each setting; `failures` has a line for each run of an estimator."""

    runs: int
    seed: int
    questions: list[QuestionResult]
    failures: list[str]

    @property
    def settings(self) -> list[SettingResult]:
        """Results of the settings of all questions."""
        return [setting for each in self.questions for setting in each.settings]

    def to_json(self) -> dict[str, Any]:
        """Return the content of exercise.json."""
        return {
            **origin(None),
            "runs": self.runs,
            "seed": self.seed,
            "questions": {each.name: each.to_json() for each in self.questions},
            "failures": self.failures,
        }


def _at(runs: Runs, steps: Int) -> AtClosure:
    """Return error and sigma of an estimator at the steps (runs,) and just before them; step -1 does not count."""
    step = steps[runs.run]
    rows = np.flatnonzero(step >= 0)

    def figure(what: str, before: int) -> float | None:
        at = rows, step[rows] - before
        return rms(np.hypot(runs.series[f"{what}_x"][at], runs.series[f"{what}_y"][at]))

    sigmas = (figure("sigma", 1), figure("sigma", 0))
    return AtClosure(
        figure("error", 1), figure("error", 0), *(None if sigma is None else 3.0 * sigma for sigma in sigmas)
    )


def _fall(found: AtClosure) -> float:
    """Return the error at a closure over that before it."""
    return (found.error_after_m or 0.0) / (found.error_before_m or 1.0)


def _before_and_after(found: AtClosure) -> str:
    return f"{found.error_before_m:.2f} to {found.error_after_m:.2f} m"


def _listed(parts: Sequence[str]) -> str:
    """Return texts as a list in a sentence."""
    return " and ".join(filter(None, (", ".join(parts[:-1]), parts[-1])))
