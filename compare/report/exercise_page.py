"""Page of the exercise, its figures, and run 0 of each setting with a replay, as `slamgauge run` writes it."""

from __future__ import annotations

from concurrent.futures import Executor, as_completed
from dataclasses import replace
from pathlib import Path
from shutil import copy
from typing import Any
from urllib.parse import quote

import numpy as np

from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.estimators.registry import CAUSAL, DEAD_RECKONING
from slamgauge.compare.exercise import tables
from slamgauge.compare.exercise.results import Exercise, SettingResult
from slamgauge.compare.exercise.settings import EKF, ESTIMATORS, GTSAM, QUESTIONS, Setting
from slamgauge.compare.figures.study_figures import save_closure_figure, save_nees_figure, save_setting_figure
from slamgauge.compare.report.page import Line, Page, Section, origin, pages_of, pictures, render, said, write_pages
from slamgauge.compare.report.run_pages import TERMS
from slamgauge.compare.scenarios.scenario import Scenario, scenario_text
from slamgauge.compare.scenarios.simulation import simulate, simulate_informed
from slamgauge.compare.scoring.comparison import compare_estimators, digest, metrics, write_comparison
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.progress import counted
from slamgauge.compare.storage.result_files import EXERCISE, METRICS, REPORT, RUN_0
from slamgauge.compare.storage.result_files import origin as provenance
from slamgauge.compare.storage.staged_folder import decorate, staged_folder
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.version import __version__

FRAMES = 240  # maps that the filter stores for the replay
DRAWN = (DEAD_RECKONING, EKF, GTSAM)
CAUSAL_OF_EKF = f"{CAUSAL}@{EKF}"  # the optimum with the associations that the filter made
# settings that have it, those without ids; with the thousand landmarks of gate 1 (2.4) it would take very long
ASSOCIATED = ("2.5", "2.6", "2.7", "2.8", "3.1", "3.2", "3.3", "3.4")
MEASUREMENTS = (
    "{} independent runs of each setting, the start drawn from the prior. In each run all estimators "
    "use the same measurements; causal and gtsam-batch also receive the true noise and associations."
)


def publish_first_runs(settings: list[SettingResult], seed: int, out: Path, executor: Executor) -> None:
    """Write run 0 of the settings into `out`, each into the folder of its figure; complete folders are kept.

    Raises:
        UserError: a foreign file would be replaced, or a folder cannot be written.
    """
    folder = out / RUN_0
    tasks = [(each.setting, each.scenario, run_seed(seed, 0), folder / each.setting.figure) for each in settings]
    missing = [task for task in tasks if not _is_complete(*task)]
    with counted(len(tasks), "setting", "run 0 with replay", len(tasks) - len(missing)) as progress:
        for done in as_completed([executor.submit(publish_first_run, *task) for task in missing]):
            done.result()
            progress.update()


def publish_first_run(setting: Setting, scenario: Scenario, seed: int, folder: Path) -> None:
    """Write a run of a setting into `folder`: estimates, metrics, the handout's figure, and a page with a replay."""
    names = _estimators_of(setting)
    truth, recording, exact = simulate_informed(scenario, seed)
    estimators = load_estimators(names, scenario.association, scenario.initialisation_settings, FRAMES)
    comparison = compare_estimators(truth, recording, estimators, exact)
    content = metrics(comparison, scenario.name, seed, scenario_text(scenario))
    title = f"Figure {setting.figure}, {setting.title} ({setting.scenario}), run 0"
    with staged_folder(folder, METRICS) as stage:
        write_comparison(stage, comparison, content)
        drawn = {name: comparison.estimates[name] for name in DRAWN if name in comparison.estimates}
        save_setting_figure(stage / "figure", truth, recording, drawn, title)
        write_pages(stage, pages_of(stage / METRICS))


def _estimators_of(setting: Setting) -> list[str]:
    return [*ESTIMATORS, *([CAUSAL_OF_EKF] if setting.figure in ASSOCIATED else [])]


def _is_complete(setting: Setting, scenario: Scenario, seed: int, folder: Path) -> bool:
    """Return whether the folder has the results of this run by this version."""
    if not (folder / METRICS).is_file():
        return False
    content = read_json(folder / METRICS)
    failed = [each["estimator"] for each in content.get("failures", ())]
    known = {*content.get("estimators", ()), *failed}
    if content.get("version") != __version__ or known != {*_estimators_of(setting)}:
        return False
    return content.get("digest") == digest(simulate(scenario, seed)[1])


def publish_exercise(out: Path, exercise: Exercise) -> bool:
    """Write the figures and the page next to exercise.json and run 0 of the settings; return whether all succeeded."""

    def draw(stage: Path) -> None:
        for name, each in exercise.by_question().items():
            title = f"Question {name[1:]}, {exercise.runs} runs"
            save_nees_figure(stage / f"{name}-nees", each.settings, title)
            save_closure_figure(stage / f"{name}-closures", each.settings, title)
        for figure in (each.setting.figure for each in exercise.settings):
            copy(out / RUN_0 / figure / "figure.png", stage / f"figure-{figure}.png")

    def write(stage: Path) -> None:
        write_pages(stage, {REPORT: render(exercise_page(stage, out / RUN_0, exercise))})

    return decorate(out, {"figures": draw, "report": write}, EXERCISE)


def exercise_page(figures: Path, run_0: Path, exercise: Exercise) -> Page:
    """Return the page of the exercise: the answer to each question, tables, figures, and links to the replays.

    `figures` is the folder of the figures of the questions, `run_0` has the folders of run 0 of the settings.
    """
    overview = replace(tables.scores(exercise.settings), id="overview")
    doubts = [*(each.doubt for each in exercise.settings if each.doubt), *exercise.failures]
    questions = exercise.by_question()
    sections = [Section("All settings", "all", tables=[overview])] if len(questions) > 1 else []
    for name, each in questions.items():
        sections += [_question(figures, name, each), *(_setting(run_0, ran) for ran in each.settings)]
    return Page(
        kind="the exercise next to its optimum",
        title="TP4: EKF-SLAM next to GTSAM batch",
        lead=[Line(f"Question {name[1:]}", each.answer(), f"#{name}") for name, each in questions.items()],
        notes=said([MEASUREMENTS.format(exercise.runs), *doubts]),
        sections=sections,
        terms=TERMS,
        origin=origin({**provenance(None), "seed": exercise.seed}, [("Runs of each setting", str(exercise.runs))]),
    )


def _question(figures: Path, name: str, found: Exercise) -> Section:
    """Return the section of a question: task, tables, and figures of all its settings."""
    question = QUESTIONS[name]
    captions = {
        f"{name}-nees.png": "Mean NEES of EKF and causal optimum over time in each setting: a filter above the band of "
        "consistent filters is overconfident, one below it is cautious.",
        f"{name}-closures.png": "The first loop closure of each lap: RMS position error (dots) and 3σ (bars) of EKF "
        "and optimum, just before and at the closure.",
    }
    shown = enumerate(tables.tables_of(found, tables.CONCLUSIONS))
    return Section(
        f"Question {name[1:]}: {question.title}",
        name,
        texts=[question.task],
        tables=[replace(table, id=f"{name}-{place}") for place, table in shown],
        pictures=pictures(figures, captions),
    )


def _setting(run_0: Path, ran: SettingResult) -> Section:
    """Return the section of a setting: its figure, what it shows, and the link to its replay."""
    setting, folder = ran.setting, run_0 / ran.setting.figure
    caption = "Run 0: map with truth, dead reckoning, EKF and GTSAM batch, and errors in their ±3σ bounds."
    return Section(
        f"Figure {setting.figure}: {setting.title} ({setting.scenario})",
        texts=[what_the_figure_shows(ran, read_json(folder / METRICS))],
        pictures=pictures(folder, {"figure.png": caption}),
        link=f"{RUN_0}/{quote(setting.figure)}/{REPORT}",
        level=3,
    )


def what_the_figure_shows(ran: SettingResult, metrics: dict[str, Any]) -> str:
    """Return the numbers of run 0: errors, share of the steps outside the 3-sigma bounds, landmarks, associations."""
    ates, outside = list[str](), list[str]()
    for name in (EKF, GTSAM, DEAD_RECKONING):
        runs = ran.study.loaded[name]
        if len(runs.run) and runs.run[0] == 0:
            ates.append(f"{runs.figures['ate_m'][0]:.2f} m ({name})")
            error = np.array([runs.series["error_x"][0], runs.series["error_y"][0]])
            sigma = np.array([runs.series["sigma_x"][0], runs.series["sigma_y"][0]])
            share = (np.abs(error) > 3.0 * sigma).any(axis=0).mean()
            outside += [] if name == DEAD_RECKONING else [f"{share:.0%} ({name})"]
    parts = [
        f"Run 0: the RMS position error is {', '.join(ates)}; x or y is outside its ±3σ bound at {', '.join(outside)} "
        "of the steps."
    ]
    entries = metrics["estimators"]
    if EKF in entries:
        ekf = entries[EKF]
        wrong = f" with {ekf['wrong_associations']} wrong associations" if ekf["wrong_associations"] else ""
        parts.append(f"The EKF maps {ekf['landmarks_mapped']} landmarks of {ekf['landmarks_true']}{wrong}.")
    if CAUSAL_OF_EKF in entries:
        ratio = entries[CAUSAL_OF_EKF]["ate_m"] / entries[CAUSAL]["ate_m"]
        parts.append(f"With the associations of the EKF the error of the causal optimum is {ratio:.2f} times as large.")
    return " ".join(parts)
