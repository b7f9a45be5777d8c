"""Tables of the exercise: accuracy and consistency, loop closures, landmarks, conclusions."""

from __future__ import annotations

from collections.abc import Sequence

from slamgauge.compare.exercise.conclusions import Conclusion, Judgement
from slamgauge.compare.exercise.results import Exercise, QuestionResult, SettingResult
from slamgauge.compare.exercise.settings import CAUSAL, EKF, GTSAM, QUESTIONS
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.optimum_notes import MARK
from slamgauge.compare.scoring.table import NO_FIGURE, Cell, Head, Page, Table, cell, figure, from_to

FIG = Head("fig", help="number of the figure in the handout; ring is a setting of slamgauge", words=True)
SETTING = Head("setting", help="what the setting changes", words=True)
SCORES = (
    FIG,
    SETTING,
    Head("EKF [m]", help="RMS position error (ATE) of the EKF, mean over runs"),
    Head("GTSAM", help="RMS position error of GTSAM batch, which uses all measurements [m]"),
    Head("x causal", help="error of the EKF over that of the causal optimum, with 95 % interval"),
    Head(
        "NEES/3", help="normalised estimation error squared of the EKF's pose over its 3 degrees of freedom: 1 is ideal"
    ),
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
)
RATIO = Head(
    "ratio of", help="two figures of the same run, with the numbers of their settings, and the range", words=True
)


def exercise_page(exercise: Exercise) -> Page:
    """Return heading, tables and answer of each question, and at the end the failures."""
    parts: list[Table | str] = []
    for each in exercise.questions:
        parts += [f"Question {each.name[1:]}. {QUESTIONS[each.name].title}: {exercise.runs} runs of each setting", ""]
        for table in tables_of(each):
            parts += [table, ""]
        answer = each.answer()
        notes = [setting.doubt for setting in each.settings]
        parts += [answer[0].upper() + answer[1:], *filter(None, notes), ""]
    return Page((*parts[:-1], *exercise.failures))


def tables_of(question: QuestionResult, *, with_ratio: bool = False) -> list[Table]:
    """Return the tables of a question that have rows; see `conclusions`."""
    settings = question.settings
    judged = conclusions(question.judgements, with_ratio=with_ratio)
    return [each for each in (scores(settings), closures(settings), landmarks(settings), judged) if each.rows]


def scores(settings: Sequence[SettingResult]) -> Table:
    """Return the table of accuracy and consistency."""
    rows: list[list[Cell]] = []
    for each in settings:
        ekf, ratio = each.estimators[EKF], figure(each.estimators[EKF]["ratio_to_causal"], "{:.2f}")
        rows.append([Cell(each.setting.figure), Cell(each.setting.title)])
        rows[-1] += [mean_of(each.estimators[name]["ate_m"], "{:.3f}") for name in (EKF, GTSAM)]
        rows[-1] += [
            ratio._replace(text=ratio.text + MARK * bool(each.doubt)),
            mean_of(ekf["nees_pose_per_dof"], "{:.2f}"),
        ]
        rows[-1] += [mean_of(ekf["coverage_95"], "{:.0%}"), Cell(each.consistency)]
    return Table(SCORES, rows, "Accuracy and consistency")


def closures(settings: Sequence[SettingResult]) -> Table:
    """Return the table of the first loop closure of each lap: figures just before and at it."""
    rows: list[list[Cell]] = []
    for figure_of, closure in ((each.setting.figure, closure) for each in settings for closure in each.closures):
        rows.append([Cell(figure_of), Cell(str(closure.lap)), figure(closure.time_s, "{:.1f}")])
        for at in (closure.estimators[name] for name in (EKF, CAUSAL)):
            for before, after in (
                (at.error_before_m, at.error_after_m),
                (at.three_sigma_before_m, at.three_sigma_after_m),
            ):
                rows[-1].append(Cell(f"{cell(before, '{:.2f}')} → {cell(after, '{:.2f}')}", before))
        rows[-1].append(figure(closure.estimators[GTSAM].error_after_m, "{:.2f}"))
    return Table(CLOSURES, rows, "The first loop closure of each lap")


def landmarks(settings: Sequence[SettingResult]) -> Table:
    """Return the table of mapped landmarks and wrong associations; no rows with known association."""
    rows: list[list[Cell]] = []
    for each in settings:
        mapped, wrong = (
            mean_of(each.estimators[EKF][key], "{:.1f}") for key in ("landmarks_mapped", "wrong_associations")
        )
        rows.append(
            [Cell(each.setting.figure), Cell(each.setting.title), mapped, figure(each.landmarks_true, "{:.1f}"), wrong]
        )
    is_unknown = any(row[-1].text not in (NO_FIGURE, "0.0") for row in rows)
    return Table(LANDMARKS, rows if is_unknown else [], "Landmarks and associations")


def conclusions(judged: Sequence[tuple[Conclusion, Judgement]], *, with_ratio: bool = False) -> Table:
    """Return the table of conclusions; with the figures that a conclusion compares if `with_ratio`."""
    heads, rows = [*CONCLUSIONS, *([RATIO] if with_ratio else [])], list[list[Cell]]()
    for conclusion, found in judged:
        ratio, needed = found.ratio, found.runs_needed
        interval = Cell(NO_FIGURE) if ratio is None else from_to(ratio.low, ratio.high, "{:.3g}")
        row = [Cell(found.verdict), Cell(conclusion.text), mean_of(ratio, "{:.3g}"), interval]
        row += [Cell(NO_FIGURE if needed is None else str(needed), needed), Cell(conclusion.hypothesis)]
        rows.append(row[: len(heads)])
    return Table(heads, rows, "Conclusions of the exercise")


def mean_of(interval: Interval | None, form: str) -> Cell:
    """Return a cell with the mean alone."""
    return figure(None if interval is None else interval.mean, form)
