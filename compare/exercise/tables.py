"""Tables of the exercise: accuracy and consistency, loop closures, landmarks, conclusions."""

from __future__ import annotations

from collections.abc import Sequence

from slamgauge.compare.exercise.conclusions import Conclusion, Judgement
from slamgauge.compare.exercise.results import Exercise, SettingResult
from slamgauge.compare.exercise.settings import CAUSAL, EKF, GTSAM, QUESTIONS
from slamgauge.compare.scoring.table import NO_FIGURE, Cell, Head, Page, Table, cell, figure, from_to, marked, sized

FIG = Head("fig", help="number of the figure in the handout; ring is a setting of slamgauge", words=True)
SETTING = Head("setting", help="what the setting changes", words=True)
SCORES = (
    FIG,
    SETTING,
    Head("EKF [m]", help="RMS position error (ATE) of the EKF, mean over runs"),
    Head("GTSAM", help="RMS position error of GTSAM batch, which uses all measurements [m]"),
    Head("x causal", help="error of the EKF over that of the causal optimum, with 95 % interval"),
    Head("NEES/3", help="NEES of the EKF's pose over its 3 degrees of freedom: 1 is ideal"),
    Head("in 95%", help="share of the true positions inside the EKF's 95 % ellipses"),
    Head("verdict", help="consistency of the EKF"),
)
CLOSURES = (
    FIG,
    Head("lap", help="lap of the loop closure, the first of its lap", words=True),
    Head("at [s]", help="mean time of the loop closure"),
    Head("EKF error [m]", help="RMS position error over runs just before the closure and at it"),
    Head("3σ [m]", help="three times the RMS position sigma that the EKF claims, before and at the closure"),
    Head("causal error", help="RMS position error of the causal optimum at the same steps [m]"),
    Head("3σ", help="three times its RMS position sigma [m]"),
    Head("GTSAM", help="RMS position error of GTSAM batch at the closure [m]"),
)
LANDMARKS = (
    FIG,
    SETTING,
    Head("mapped", help="number of landmarks in the map of the EKF"),
    Head("of", help="number of landmarks that were observed"),
    Head("wrong associations", help="observations that the EKF assigned to another landmark than their own"),
)
CONCLUSIONS = (
    Head("verdict", help="verdict on the conclusion", words=True),
    Head("conclusion of the exercise", help="the conclusion in short", words=True, wraps=True),
    Head("ratio", help="geometric mean over runs of the ratio"),
    Head("interval", help="95 % interval of the ratio that holds for all conclusions of the exercise together"),
    Head("runs needed", help="runs that would decide an undecided conclusion with 90 % probability"),
    Head("ratio of", help="two figures of the same run with their settings, and the asserted range", words=True),
)


def exercise_page(exercise: Exercise) -> Page:
    """Return heading, tables and answer of each question, and at the end the failures."""
    parts: list[Table | str] = []
    for name, each in exercise.by_question().items():
        parts += ["", f"Question {name[1:]}. {QUESTIONS[name].title}: {exercise.runs} runs of each setting", ""]
        for table in tables_of(each, CONCLUSIONS[:-1]):
            parts += [table, ""]
        answer = each.answer()
        parts.append(answer[0].upper() + answer[1:])
        parts += [ran.doubt for ran in each.settings if ran.doubt]
    return Page((*parts[1:], *exercise.failures))


def tables_of(question: Exercise, heads: Sequence[Head]) -> list[Table]:
    """Return the tables of a question that have rows; `heads` are those of its conclusions."""
    ran, judged = question.settings, conclusions(question.judgements, heads)
    return [each for each in (scores(ran), closures(ran), landmarks(ran), judged) if each.rows]


def scores(settings: Sequence[SettingResult]) -> Table:
    """Return the table of accuracy and consistency."""
    rows: list[list[Cell | str]] = []
    for each in settings:
        ekf, gtsam = each.study.estimators[EKF], each.study.estimators[GTSAM]
        row = [
            figure(sized(ekf["ate_m"]), "{:.3f}"),
            figure(sized(gtsam["ate_m"]), "{:.3f}"),
            marked(figure(ekf["ratio_to_causal"], "{:.2f}"), True if each.doubt else None),
            figure(sized(ekf["nees_pose_per_dof"]), "{:.2f}"),
            figure(sized(ekf["coverage_95"]), "{:.0%}"),
        ]
        rows.append([each.setting.figure, each.setting.title, *row, each.consistency])
    return Table.of(SCORES, rows, "Accuracy and consistency")


def closures(settings: Sequence[SettingResult]) -> Table:
    """Return the table of the first loop closure of each lap: figures just before and at it."""
    rows: list[list[Cell | str]] = []
    for each in settings:
        for closure in each.loop_closures:
            ekf, causal, gtsam = (closure.estimators[name] for name in (EKF, CAUSAL, GTSAM))
            pairs = (ekf["error_m"], ekf["three_sigma_m"], causal["error_m"], causal["three_sigma_m"])
            cells = [Cell(f"{cell(before, '{:.2f}')} → {cell(at, '{:.2f}')}", before) for before, at in pairs]
            start = [each.setting.figure, str(closure.lap), figure(closure.time_s, "{:.1f}")]
            rows.append([*start, *cells, figure(gtsam["error_m"][1], "{:.2f}")])
    return Table.of(CLOSURES, rows, "The first loop closure of each lap")


def landmarks(settings: Sequence[SettingResult]) -> Table:
    """Return the table of mapped landmarks and wrong associations; no rows with known association."""
    rows: list[list[Cell]] = []
    for each in settings:
        mapped, wrong = (each.study.estimators[EKF][key] for key in ("landmarks_mapped", "wrong_associations"))
        cells = [figure(sized(count), "{:.1f}") for count in (mapped, each.landmarks_true, wrong)]
        rows.append([Cell(each.setting.figure), Cell(each.setting.title), *cells])
    is_unknown = any(row[-1].text not in (NO_FIGURE, "0.0") for row in rows)
    return Table(LANDMARKS, rows if is_unknown else [], "Landmarks and associations")


def conclusions(judged: Sequence[tuple[Conclusion, Judgement]], heads: Sequence[Head]) -> Table:
    """Return the table of conclusions with the first of the columns `CONCLUSIONS`."""
    rows: list[list[Cell | str]] = []
    for conclusion, found in judged:
        ratio = found.ratio
        interval = Cell(NO_FIGURE) if ratio is None else from_to(ratio.low, ratio.high, "{:.3g}")
        figures = (figure(sized(ratio), "{:.3g}"), interval, figure(found.runs_needed, "{:.0f}"))
        rows.append([found.verdict, conclusion.text, *figures, conclusion.hypothesis][: len(heads)])
    return Table.of(heads, rows, "Conclusions of the exercise")
