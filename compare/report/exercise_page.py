"""Page of the exercise: the answer to each question, tables, figures with numbers, and links to the replays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from shutil import copy
from typing import Any
from urllib.parse import quote

import numpy as np

from slamgauge.compare.exercise import tables
from slamgauge.compare.exercise.results import Exercise, QuestionResult, SettingResult
from slamgauge.compare.exercise.settings import CAUSAL, CAUSAL_OF_EKF, DEAD_RECKONING, EKF, GTSAM, QUESTIONS
from slamgauge.compare.figures.exercise_figures import save_closure_figure, save_nees_figure
from slamgauge.compare.report.page import TERMS, render
from slamgauge.compare.report.page_elements import Line, Page, Section, origin, pictures, said
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import EXERCISE, METRICS, REPORT, RUN_0
from slamgauge.compare.storage.result_files import origin as provenance
from slamgauge.compare.storage.staged_folder import decorate


def publish_exercise(out: Path, exercise: Exercise) -> bool:
    """Write the figures and the page next to exercise.json and run 0 of the settings; return whether all succeeded."""
    figures = [each.setting.figure for each in exercise.settings]

    def draw(stage: Path) -> None:
        for each in exercise.questions:
            title = f"Question {each.name[1:]}, {exercise.runs} runs"
            save_nees_figure(stage / f"{each.name}-nees", each.settings, title)
            save_closure_figure(stage / f"{each.name}-closures", each.settings, title)
        for figure in figures:
            copy(out / RUN_0 / figure / "figure.png", stage / f"figure-{figure}.png")

    def write(stage: Path) -> None:
        (stage / REPORT).write_text(exercise_page(stage, out / RUN_0, exercise), encoding="utf-8", newline="\n")

    return decorate(out, {"figures": draw, "report": write}, EXERCISE)


def exercise_page(figures: Path, run_0: Path, exercise: Exercise) -> str:
    """Return the page of the exercise, HTML.

    Args:
        figures: folder of the figures of the questions.
        run_0: folder with the folders of run 0 of each setting.
        exercise: results.
    """
    overview = replace(tables.scores(exercise.settings), id="overview")
    doubts = [*(each.doubt for each in exercise.settings if each.doubt), *exercise.failures]
    page = Page(
        kind="the exercise next to its optimum",
        title="TP4: EKF-SLAM next to GTSAM batch",
        lead=[Line(f"Question {each.name[1:]}", each.answer(), f"#{each.name}") for each in exercise.questions],
        notes=said([_measurements(exercise), *doubts]),
        sections=[
            *([Section("All settings", "all", tables=[overview])] if len(exercise.questions) > 1 else []),
            *(section for each in exercise.questions for section in _sections(figures, run_0, each)),
        ],
        terms=TERMS["run"],
        origin=origin({**provenance(None), "seed": exercise.seed}, [("Runs of each setting", str(exercise.runs))]),
    )
    return render(page)


def _measurements(exercise: Exercise) -> str:
    return (
        f"{exercise.runs} independent runs of each setting, the start drawn from the prior. In each run all estimators "
        "use the same measurements; causal and gtsam-batch also receive the true noise and associations."
    )


def _sections(figures: Path, run_0: Path, found: QuestionResult) -> list[Section]:
    """Return the section of a question: task, tables, and figures of all its settings; then those of its settings."""
    name, question = found.name, QUESTIONS[found.name]
    known = {
        f"{name}-nees.png": (
            "Mean NEES of EKF and causal optimum over time in each setting, with the band of consistent filters",
            "NEES over time: a filter above the band is overconfident, one below it is cautious.",
        ),
        f"{name}-closures.png": (
            "Position errors and three sigma of EKF and optimum just before and at the loop closures of each setting",
            "The first loop closure of each lap: RMS position error (dots) and 3σ (bars), before and at the closure.",
        ),
    }
    shown = tables.tables_of(found, with_ratio=True)
    section = Section(
        f"Question {name[1:]}: {question.title}",
        name,
        texts=[*filter(None, (question.task, found.largest_correction()))],
        tables=[replace(table, id=f"{name}-{place}") for place, table in enumerate(shown)],
        pictures=pictures(figures, known),
    )
    return [section, *(_setting(run_0, each) for each in found.settings)]


def _setting(run_0: Path, ran: SettingResult) -> Section:
    """Return the section of a setting: its figure, what it shows, and the link to its replay."""
    setting, folder = ran.setting, run_0 / ran.setting.figure
    alt = f"Figure {setting.figure}: map with truth, dead reckoning, EKF and GTSAM batch, and errors in ±3σ bounds"
    return Section(
        f"Figure {setting.figure}: {setting.title} ({setting.scenario})",
        texts=[what_the_figure_shows(ran, read_json(folder / METRICS, "exercise"))],
        pictures=pictures(folder, {"figure.png": (alt, "Run 0: map, and errors in their ±3σ bounds.")}),
        link=f"{RUN_0}/{quote(setting.figure)}/{REPORT}",
        level=3,
    )


def what_the_figure_shows(ran: SettingResult, metrics: dict[str, Any]) -> str:
    """Return the numbers of run 0: errors, share of the steps outside the 3-sigma bounds, landmarks, associations."""
    names = [name for name in (EKF, GTSAM, DEAD_RECKONING) if len(ran.runs[name].run) and ran.runs[name].run[0] == 0]
    ates = [f"{ran.runs[name].figures['ate_m'][0]:.2f} m ({name})" for name in names]
    outside = [f"{_share_outside(ran.runs[name]):.0%} ({name})" for name in names if name != DEAD_RECKONING]
    parts = [
        f"Run 0: the RMS position error is {', '.join(ates)}; x or y is outside its ±3σ bound at {', '.join(outside)} "
        "of the steps."
    ]
    entries = metrics["estimators"]
    if EKF in entries:
        ekf = entries[EKF]
        text = f"The EKF maps {ekf['landmarks_mapped']} landmarks of {ekf['landmarks_true']}"
        wrong = ekf["wrong_associations"]
        parts.append(f"{text} with {wrong} wrong associations." if wrong else f"{text}.")
    if CAUSAL_OF_EKF in entries:
        ratio = entries[CAUSAL_OF_EKF]["ate_m"] / entries[CAUSAL]["ate_m"]
        parts.append(f"With the associations of the EKF the error of the causal optimum is {ratio:.2f} times as large.")
    return " ".join(parts)


def _share_outside(runs: Runs) -> float:
    """Return the share of the steps of the first run at which the error in x or y exceeds three sigma."""
    error, sigma = (np.array([runs.series[f"{what}_{axis}"][0] for axis in "xy"]) for what in ("error", "sigma"))
    return float((np.abs(error) > 3.0 * sigma).any(axis=0).mean())
