"""Runs of the exercise: EKF and optima on the same measurements, stored like those of a study.

Every setting has a store in `studies/FIGURE` with its filters, and shares the store of the optima with the settings of
the same measurements.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor, wait
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.compare.exercise.conclusions import CONCLUSIONS
from slamgauge.compare.exercise.judgements import judge
from slamgauge.compare.exercise.results import Exercise, QuestionResult, SettingResult
from slamgauge.compare.exercise.settings import EKF, FILTERS, OPTIMA, QUESTIONS, SETTINGS, Setting, require_questions
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scenarios.simulation import informed, simulate
from slamgauge.compare.scoring.run_arrays import closure_steps
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.storage.result_files import STORE, STUDIES
from slamgauge.compare.storage.staged_folder import begin_folder, require_ours
from slamgauge.compare.studies.store import digest
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.compare.studies.study_run import require_numbers, run_once, run_seed
from slamgauge.compare.studies.summary import failure_lines


class Part(NamedTuple):
    """A study: scenario, names of estimators and folder of its store."""

    scenario: Scenario
    estimators: tuple[str, ...]
    folder: Path


def run_exercise(names: Sequence[str], runs: int, seed: int, out: str | Path, executor: Executor) -> Exercise:
    """Run what `out` lacks of some questions, and judge their conclusions.

    Args:
        names: questions, `q1` to `q4`; none for all.
        runs: number of independent runs of each setting.
        seed: root seed.
        out: folder of the stores (`studies`).
        executor: see `run_study`.

    Raises:
        UserError: an unknown question, a bad number, a store of another study, or a foreign file in the place of one.
    """
    questions, out = require_questions(tuple(names)), Path(out)
    require_numbers(runs, seed)
    begin_folder(out)
    chosen = [each for name in questions for each in QUESTIONS[name].settings]
    compared = [
        SETTINGS[measure.figure] for each in CONCLUSIONS if each.question in questions for measure in each.below
    ]
    _compile_at_once(parts(chosen[0], seed, out), seed, executor)
    loaded = dict[tuple[str, str], Runs]()
    failures = dict[str, None]()
    for setting in dict.fromkeys([*chosen, *compared]):
        for part in parts(setting, seed, out, with_optima=setting in chosen):
            summary = run_study(part.scenario, runs, seed, part.estimators, part.folder, executor)
            failures |= dict.fromkeys(f"figure {setting.figure}, {line}" for line in failure_lines(summary))
            found = load_runs(part.scenario, runs, seed, part.estimators, part.folder)
            loaded |= {(setting.figure, name): each for name, each in found.items()}
    results = [
        QuestionResult(
            name,
            [_setting_result(each, loaded, runs, seed) for each in QUESTIONS[name].settings],
            [(each, judge(each, loaded)) for each in CONCLUSIONS if each.question == name],
        )
        for name in questions
    ]
    return Exercise(runs, seed, results, [*failures])


def _compile_at_once(found: Sequence[Part], seed: int, executor: Executor) -> None:
    """On first use compile the kernels of the filters and those of the optima at the same time, by a run of each."""
    from slamgauge.jit import stored_files  # here: it loads numba

    if not stored_files() and not any((part.folder / STORE).exists() for part in found):
        wait([executor.submit(run_once, part.scenario, run_seed(seed, 0), part.estimators) for part in found])


def parts(setting: Setting, seed: int, out: Path, *, with_optima: bool = True) -> list[Part]:
    """Return the studies of a setting: its filters, and its optima."""
    scenario = load_scenario(setting.scenario)
    studies = out / STUDIES
    found = [Part(scenario, FILTERS if with_optima else (EKF,), studies / setting.figure)]
    if with_optima:
        exact = informed(scenario)  # equal for settings with the same measurements
        found.append(Part(exact, OPTIMA, studies / f"optima-{digest(exact, seed)[:12]}"))
    require_ours(*(part.folder for part in found))
    return found


def _setting_result(setting: Setting, loaded: dict[tuple[str, str], Runs], runs: int, seed: int) -> SettingResult:
    scenario = load_scenario(setting.scenario)
    closures = [_first_closures(scenario, run_seed(seed, run)) for run in range(runs)]
    found = {name: loaded[setting.figure, name] for name in (*FILTERS, *OPTIMA)}
    return SettingResult(setting, scenario, found, np.array(closures, dtype=np.int64))


def _first_closures(scenario: Scenario, seed: int) -> list[int]:
    """Return the step of the first loop closure in each lap of a run, -1 without one."""
    truth, recording = simulate(scenario, seed)
    steps = closure_steps(truth, recording)
    assert truth.poses is not None and steps is not None
    turns = np.abs(np.unwrap(truth.poses[:, 2]) - truth.poses[0, 2]) / (2.0 * math.pi)
    laps = np.floor(turns + 1e-9).astype(np.int64)  # full turns at each step
    firsts = [steps[laps[steps] == lap][:1] for lap in range(math.ceil(turns.max() - 1e-2))]
    return [int(each[0]) if len(each) else -1 for each in firsts]
