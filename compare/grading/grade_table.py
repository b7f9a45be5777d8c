"""The table of grades."""

from __future__ import annotations

from slamgauge.compare.grading.grades import Grade
from slamgauge.compare.grading.grading import Grades
from slamgauge.compare.scoring.text_page import Grid, Page
from slamgauge.compare.scoring.text_table import cell, interval_cell

HEAD = ("ATE [m]", "x", "NEES/3", "x", "sigma x", "heading sigma x", "x causal", "laws failed", "time [s]")


def grade_table(grades: Grades) -> Page:
    """A line for each submission, under that of the reference; below, why they have not passed."""
    head = ["submission", "verdict", *(f"{title} {grades.reference}" if title[-1:] == "x" else title for title in HEAD)]
    rows = [head, [f"({grades.reference})", "reference", *_figures(grades.reference_grade)]]
    rows += [[each.submission, verdict(each), *_figures(each)] for each in grades.grades]
    said = [f"{each.submission}: {'; '.join(each.reasons)}" for each in grades.grades if each.reasons]
    return Page((Grid(rows, words=2), *said, _sum(grades)))


def verdict(grade: Grade) -> str:
    """In a word or two."""
    return "passed" if grade.passed else "FAILED" if grade.is_graded else "not graded"


def _figures(grade: Grade) -> list[str]:
    found = grade.reference
    if found is None:
        return ["-"] * len(HEAD)
    ratios = (found.sigma_position, found.sigma_heading, grade.ratio_to_optimum)
    return [
        interval_cell(grade.ate_m, "{:.3f}"),
        interval_cell(found.ate, "{:.3f}"),
        interval_cell(grade.nees, "{:.2f}"),
        interval_cell(found.nees, "{:.2f}"),
        *(interval_cell(ratio, "{:.3f}") for ratio in ratios),
        str(len(grade.failed_laws)) if grade.trial.verdicts else "-",
        cell(grade.seconds, "{:.2f}"),
    ]


def _sum(grades: Grades) -> str:
    graded = sum(each.is_graded for each in grades.grades)
    passed = sum(each.passed for each in grades.grades)
    return f"{graded} of {len(grades.grades)} graded, {passed} passed"
