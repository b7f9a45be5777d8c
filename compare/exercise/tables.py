"""Tables of the exercise: accuracy and consistency, loop closures, landmarks, conclusions.

The page of the exercise shows the same cells.
"""

from __future__ import annotations

from collections.abc import Sequence

from slamgauge.compare.exercise.conclusions import Conclusion, Judgement
from slamgauge.compare.exercise.results import AtClosure, QuestionResult, SettingResult
from slamgauge.compare.exercise.settings import CAUSAL, EKF, GTSAM, QUESTIONS
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.optimum_notes import MARK
from slamgauge.compare.scoring.text_page import Grid, Page
from slamgauge.compare.scoring.text_table import NO_FIGURE, cell, interval_cell

HEAD = ("fig", "setting")
SCORES = (*HEAD, "EKF [m]", "GTSAM", "x causal", "NEES/3", "in 95%", "verdict")
CLOSURES = ("fig", "lap", "at [s]", "EKF error [m]", "3σ [m]", "causal error", "3σ", "GTSAM")
LANDMARKS = (*HEAD, "mapped", "of", "wrong associations")
CONCLUSIONS = ("verdict", "conclusion of the exercise", "ratio", "interval", "runs needed", "ratio of")


def exercise_page(found: Sequence[QuestionResult], runs: int, failures: Sequence[str]) -> Page:
    """Return heading, tables and answer of each question, and at the end the failures."""
    parts: list[Grid | str] = []
    for each in found:
        parts += [f"Question {each.name[1:]}. {QUESTIONS[each.name].title}: {runs} runs of each setting", ""]
        for rows in (scores(each.settings), closures(each.settings), landmarks(each.settings)):
            if len(rows) > 1:
                parts += [Grid(rows, words=2), ""]
        if each.judgements:
            rows = [row[:-1] for row in conclusions(each.judgements)]  # the page also shows which figures are compared
            parts += [Grid(rows, words=2, sentences=1), ""]
        notes = [each.largest_correction(), *(setting.doubt for setting in each.settings)]
        parts += [_sentence(each.answer()), *filter(None, notes), ""]
    return Page((*parts[:-1], *failures))


def scores(settings: Sequence[SettingResult]) -> list[Sequence[str]]:
    """Return the rows of accuracy and consistency, with their head."""
    return [SCORES, *map(_score, settings)]


def _score(each: SettingResult) -> list[str]:
    ates = (_mean(each.estimators[name].ate_m, "{:.3f}") for name in (EKF, GTSAM))
    nees, inside = each.ekf.nees_pose_per_dof, each.ekf.others["coverage_95"]
    return [
        *(each.setting.figure, each.setting.title, *ates),
        interval_cell(each.ekf.ratio_to_causal, "{:.2f}") + MARK * bool(each.doubt),
        *(_mean(nees, "{:.2f}"), _mean(inside, "{:.0%}"), each.consistency),
    ]


def closures(settings: Sequence[SettingResult]) -> list[Sequence[str]]:
    """Return the rows of the first loop closure of each lap, with their head: figures just before and at it."""
    rows = [
        [
            *(each.setting.figure, str(closure.lap), f"{closure.time_s:.1f}"),
            *(text for name in (EKF, CAUSAL) for text in _before_and_after(closure.estimators[name])),
            cell(closure.estimators[GTSAM].error_after_m, "{:.2f}"),
        ]
        for each in settings
        for closure in each.closures
    ]
    return [CLOSURES, *rows]


def _before_and_after(found: AtClosure) -> tuple[str, str]:
    pairs = (found.error_before_m, found.error_after_m), (found.three_sigma_before_m, found.three_sigma_after_m)
    error, sigma = (" → ".join(cell(each, "{:.2f}") for each in pair) for pair in pairs)
    return error, sigma


def landmarks(settings: Sequence[SettingResult]) -> list[Sequence[str]]:
    """Return the rows of mapped landmarks and wrong associations, with their head; none with known association."""
    rows = [
        [
            *(each.setting.figure, each.setting.title, _mean(each.ekf.landmarks_mapped, "{:.1f}")),
            *(cell(each.landmarks_true, "{:.1f}"), _mean(each.ekf.wrong_associations, "{:.1f}")),
        ]
        for each in settings
    ]
    is_unknown = any(row[-1] not in (NO_FIGURE, "0.0") for row in rows)
    return [LANDMARKS, *rows] if is_unknown else [LANDMARKS]


def conclusions(judged: Sequence[tuple[Conclusion, Judgement]]) -> list[Sequence[str]]:
    """Return the rows of conclusions, with their head."""
    return [CONCLUSIONS, *(_conclusion(*pair) for pair in judged)]


def _conclusion(conclusion: Conclusion, judgement: Judgement) -> list[str]:
    ratio, needed = judgement.ratio, judgement.runs_needed
    interval = NO_FIGURE
    if ratio is not None and ratio.low is not None and ratio.high is not None:
        interval = f"{ratio.low:.3g} to {ratio.high:.3g}"
    return [
        *(judgement.verdict, conclusion.text, _mean(ratio, "{:.3g}"), interval),
        *(NO_FIGURE if needed is None else str(needed), conclusion.hypothesis),
    ]


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]


def _mean(interval: Interval | None, form: str) -> str:
    return cell(None if interval is None else interval.mean, form)
