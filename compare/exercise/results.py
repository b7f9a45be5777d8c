"""Results of the exercise: runs of EKF and optima on the same measurements, their figures, and answers in a sentence.

Runs are stored like those of a study. Every setting has a store in `studies/FIGURE` with its filters, and shares the
store of the optima with the settings of the same measurements.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic_core import to_jsonable_python

from slamgauge.arrays import Int
from slamgauge.compare.estimators.requests import ask
from slamgauge.compare.exercise.conclusions import CONCLUSIONS, Conclusion, Judgement, judge
from slamgauge.compare.exercise.settings import CAUSAL, EKF, ESTIMATORS, GTSAM, QUESTIONS, SETTINGS, Setting
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scenarios.simulation import informed, simulate
from slamgauge.compare.scoring.intervals import mean, rms
from slamgauge.compare.scoring.optimum_notes import doubt_in_runs
from slamgauge.compare.scoring.run_arrays import closure_steps
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.scoring.table import cell
from slamgauge.compare.storage.result_files import STUDIES, origin
from slamgauge.compare.storage.staged_folder import begin_folder
from slamgauge.compare.studies.stored_study import optima_beside
from slamgauge.compare.studies.study import run_beside_optima
from slamgauge.compare.studies.study_run import require_numbers, run_seed
from slamgauge.compare.studies.summary import Summary, failure_lines
from slamgauge.errors import UserError

PLURALS = {"holds": "hold", "does not hold": "do not hold", "is undecided": "are undecided"}
AtClosure = dict[str, tuple[float | None, float | None]]  # figures just before a step, and at it


@dataclass(frozen=True)
class Closure:
    """The first loop closure of a lap: mean time [s] over `runs` runs with one, and the estimators at that step.

    `error_m` is the RMS over runs of the position error, `three_sigma_m` three times that of the position sigma.
    """

    lap: int
    time_s: float
    runs: int
    estimators: dict[str, AtClosure]


@dataclass(frozen=True)
class SettingResult:
    """Scenario and study of a setting, with the runs of each estimator; mean number of observed landmarks."""

    setting: Setting
    scenario: Scenario
    study: Summary
    landmarks_true: float | None

    @property
    def consistency(self) -> str:
        """`consistent`, `overconfident` or `cautious`, as far as the runs show; `-` without a NEES."""
        nees, faults = (self.study.estimators[EKF][key] for key in ("nees_pose_per_dof", "faults"))
        if nees is None:
            return "-"
        if not any("a sigma" in fault for fault in faults):
            return "consistent"
        return "overconfident" if nees.mean > 1.0 else "cautious"

    @property
    def doubt(self) -> str | None:
        """Return that the causal optimum, the reference of the ratio, is in doubt in some runs; None if it is not."""
        return doubt_in_runs(f"{self.setting.figure}: {CAUSAL}", self.study.estimators[CAUSAL]["optimum_check_share"])

    @cached_property
    def loop_closures(self) -> list[Closure]:
        """The first loop closure of each lap that has one."""
        seeds = [run_seed(self.study.seed, run) for run in range(self.study.runs)]
        found: list[Closure] = []
        for lap, steps in enumerate(np.array([first_closures(self.scenario, seed) for seed in seeds]).T, 1):
            known = steps[steps >= 0]
            if len(known):
                at = {name: _at(self.study.loaded[name], steps) for name in (EKF, CAUSAL, GTSAM)}
                found.append(Closure(lap, float(known.mean()) * self.scenario.trajectory.step, len(known), at))
        return found


@dataclass(frozen=True)
class Exercise:
    """Results of questions over `runs` runs of each setting; `failures` has a line for each run of an estimator."""

    runs: int
    seed: int
    failures: list[str]
    settings: list[SettingResult]
    judgements: list[tuple[Conclusion, Judgement]]

    def by_question(self) -> dict[str, Exercise]:
        """Return the results of each question."""
        found: dict[str, Exercise] = {}
        for name in dict.fromkeys(each.setting.question for each in self.settings):
            settings = [each for each in self.settings if each.setting.question == name]
            judged = [each for each in self.judgements if each[0].id.startswith(name)]
            found[name] = replace(self, settings=settings, judgements=judged)
        return found

    def answer(self) -> str:
        """Return in a sentence how accurate and consistent the EKF is, and how many conclusions hold."""
        ratios = [(each.study.estimators[EKF]["ratio_to_causal"], each.setting) for each in self.settings]
        known = sorted((pair for pair in ratios if pair[0]), key=lambda pair: pair[0].mean)
        ends = known[:: max(1, len(known) - 1)]  # the smallest and the largest
        shown = [f"{cell(ratio, '{:.2f}')} ({setting.figure}, {setting.title})" for ratio, setting in ends]
        accuracy = f"the error of the EKF is {' to '.join(shown)} times that of the causal optimum"
        parts = [accuracy if known else "no run has both the EKF and the causal optimum"]
        places: dict[str, list[str]] = {}
        for each in self.settings:
            places.setdefault(each.consistency, []).append(each.setting.figure)
        words = [f"{word} in {_listed(figures)}" for word, figures in places.items() if word != "-"]
        parts += [f"it is {_listed(words)}"] if words else []
        verbs = Counter(judged.verdict.replace("undecided", "is undecided") for _, judged in self.judgements)
        verdicts = [f"{count} {verb if count == 1 else PLURALS[verb]}" for verb, count in verbs.most_common()]
        parts += [f"of the exercise's {len(self.judgements)} conclusions {_listed(verdicts)}"] if verdicts else []
        return f"{'; '.join(parts)}."

    def to_json(self) -> dict[str, Any]:
        """Return the content of exercise.json."""
        questions: dict[str, Any] = {}
        for name, each in self.by_question().items():
            settings = [
                _fields(ran.setting, "figure", "scenario", "title")
                | _fields(ran, "consistency", "landmarks_true", "loop_closures")
                | {"estimators": {label: found.to_json() for label, found in ran.study.estimators.items()}}
                for ran in each.settings
            ]
            conclusions = [
                _fields(conclusion, "id", "text", "hypothesis", "asserted")
                | _fields(found, "verdict", "ratio", "runs", "runs_needed")
                for conclusion, found in each.judgements
            ]
            found = {"answer": each.answer(), "settings": settings, "conclusions": conclusions}
            questions[name] = QUESTIONS[name]._asdict() | found
        content = origin(None) | _fields(self, "runs", "seed", "failures") | {"questions": questions}
        return to_jsonable_python(content, inf_nan_mode="null")


def _fields(found: object, *names: str) -> dict[str, Any]:
    return {name: getattr(found, name) for name in names}


def run_exercise(names: Sequence[str], runs: int, seed: int, out: str | Path, executor: Executor) -> Exercise:
    """Run what `out` lacks of some questions, none for all, and judge their conclusions; see `run_study`.

    Raises:
        UserError: an unknown question, a bad number, a store of another study, or a foreign file in the place of one.
    """
    for name in names:
        if name not in QUESTIONS:
            raise UserError(f"question {name!r} is not known; use {', '.join(QUESTIONS)}")
    require_numbers(runs, seed)
    begin_folder(Path(out))
    questions = [name for name in QUESTIONS if name in names or not names]
    chosen = [each for each in SETTINGS.values() if each.question in questions]
    concluded = [each for each in CONCLUSIONS if each.id.partition("-")[0] in questions]
    compared = [SETTINGS[measure.setting] for each in concluded for measure in each.measures]
    found: dict[str, SettingResult] = {}
    for setting in dict.fromkeys([*chosen, *compared]):
        estimators = ESTIMATORS if setting in chosen else (EKF,)
        found[setting.figure] = run_setting(setting, estimators, runs, seed, Path(out), executor)
    failures = [f"figure {figure}, {line}" for figure, ran in found.items() for line in failure_lines(ran.study)]
    loaded = {figure: ran.study.loaded for figure, ran in found.items()}
    judgements = [(each, judge(each, loaded)) for each in concluded]
    return Exercise(runs, seed, failures, [found[each.figure] for each in chosen], judgements)


def run_setting(
    setting: Setting, estimators: Sequence[str], runs: int, seed: int, out: Path, executor: Executor
) -> SettingResult:
    """Run what `out` lacks of a setting with these estimators."""
    scenario, studies = load_scenario(setting.scenario), out / STUDIES
    places = studies / setting.figure, optima_beside(studies, informed(scenario), seed, "optima-")
    study = run_beside_optima(scenario, ask(estimators), runs, seed, places, executor)
    return SettingResult(setting, scenario, study, mean(study.loaded[EKF].figures["landmarks_true"]))


def first_closures(scenario: Scenario, seed: int) -> list[int]:
    """Return the step of the first loop closure in each lap of a run, -1 without one."""
    truth, recording = simulate(scenario, seed)
    steps = closure_steps(truth, recording)
    assert truth.poses is not None and steps is not None
    turns = np.abs(np.unwrap(truth.poses[:, 2]) - truth.poses[0, 2]) / (2.0 * math.pi)
    laps = np.floor(turns + 1e-9).astype(np.int64)  # full turns at each step
    first = dict(zip(laps[steps][::-1].tolist(), steps[::-1].tolist(), strict=True))  # the last entry of a lap stays
    return [first.get(lap, -1) for lap in range(math.ceil(turns.max() - 1e-2))]


def _at(runs: Runs, steps: Int) -> AtClosure:
    """Return error and sigma of an estimator at the steps (runs,) and just before them; step -1 does not count."""
    step = steps[runs.run]
    rows = np.flatnonzero(step >= 0)
    before, after = (rows, step[rows] - 1), (rows, step[rows])
    error = np.hypot(runs.series["error_x"], runs.series["error_y"])
    bound = 3.0 * np.hypot(runs.series["sigma_x"], runs.series["sigma_y"])
    found = {"error_m": error, "three_sigma_m": bound}
    return {key: (rms(figure[before]), rms(figure[after])) for key, figure in found.items()}


def _listed(parts: Sequence[str]) -> str:
    """Return texts as a list in a sentence."""
    return " and ".join(filter(None, (", ".join(parts[:-1]), parts[-1])))
