"""Output of grades: a table for the terminal, files for spreadsheets and Gradescope, and a page for each submission."""

from __future__ import annotations

import html
import json
from pathlib import Path

from slamgauge.compare.checks.examination import verdicts_table
from slamgauge.compare.grading.grades import Grade
from slamgauge.compare.grading.gradescope import gradescope_json
from slamgauge.compare.grading.grading import Grades
from slamgauge.compare.grading.rubric import Mark
from slamgauge.compare.scoring.table import Head, Table, cell, interval_cell
from slamgauge.compare.scoring.text_page import Page
from slamgauge.compare.storage.files import explained, write_csv
from slamgauge.compare.storage.result_files import GRADES, GRADESCOPE, PAGES, RESULTS, RUBRIC
from slamgauge.compare.storage.staged_folder import Drawing, decorate

HEAD = ("ATE [m]", "x", "NEES/3", "x", "sigma x", "heading sigma x", "x causal", "checks failed", "time [s]")


def grade_table(grades: Grades) -> Page:
    """Return a table with a row for the reference and for each submission, and below it the reasons for failures."""
    name = grades.reference_grade.submission
    head = ["submission", "verdict", "points", *(f"{title} {name}" if title[-1:] == "x" else title for title in HEAD)]
    rows = [[f"({name})", "reference", "-", *_cells(grades.reference_grade)]]
    rows += [[each.submission, verdict(each), f"{each.mark.points:g}", *_cells(each)] for each in grades.grades]
    reasons = [f"{each.submission}: {'; '.join(each.reasons)}" for each in grades.grades if each.reasons]
    reasons += [
        f"{each.submission}, for the teacher: {'; '.join(each.remarks)}" for each in grades.grades if each.remarks
    ]
    graded, passed = (sum(getattr(each, name) for each in grades.grades) for name in ("is_graded", "passed"))
    heads = [Head(title, words=place < 2) for place, title in enumerate(head)]
    return Page((Table.of(heads, rows), *reasons, f"{graded} of {len(grades.grades)} graded, {passed} passed"))


def verdict(grade: Grade) -> str:
    """Return the verdict as text."""
    return "passed" if grade.passed else "FAILED" if grade.is_graded else "not graded"


def _cells(grade: Grade) -> list[str]:
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
        str(len(grade.failed_checks)) if grade.trial.verdicts else "-",
        cell(grade.seconds, "{:.2f}"),
    ]


def write_grades(folder: Path, grades: Grades) -> None:
    """Write grades.csv, the rubric and the results for Gradescope into an existing folder.

    Raises:
        UserError: a file cannot be written.
    """
    rows = [{key: value for key, value in row.items() if key != "scenario_text"} for row in grades.to_json()]
    with explained(folder, "written"):
        with (folder / GRADES).open("w", encoding="utf-8", newline="") as file:
            cells = ([str(it).lower() if isinstance(it, bool) else it for it in row.values()] for row in rows)
            write_csv(file, [rows[0], *cells])  # spreadsheets read true and false
        (folder / RUBRIC).write_text(grades.settings.rubric.text, encoding="utf-8")
        for each in grades.grades:
            results = json.dumps(gradescope_json(each), indent=2, allow_nan=False)
            place = folder / GRADESCOPE / each.submission
            place.mkdir(parents=True)
            for path in (place, *([folder] * (len(grades.grades) == 1))):
                (path / RESULTS).write_text(f"{results}\n", encoding="utf-8")


def write_pages(out: Path, grades: Grades) -> bool:
    """Write a page for each submission into the folder `out` of the grades; return whether all could be written."""

    def writes(each: Grade) -> Drawing:
        def write(stage: Path) -> None:
            (stage / PAGES).mkdir(exist_ok=True)
            (stage / PAGES / f"{each.submission}.md").write_text(_page(each, grades), encoding="utf-8")

        return write

    pages = {f"{PAGES}/{each.submission}": writes(each) for each in grades.grades}
    return decorate(out, pages, GRADES)


def _page(grade: Grade, grades: Grades) -> str:
    """Return the page for the author of a submission: Markdown; HTML in texts of the submission is escaped."""
    trial, reference, runs = grade.trial, grades.reference_grade.submission, grades.settings.runs
    lines = [
        f"# {grade.submission}: {verdict(grade)}",
        "",
        f"{grades.settings.scenario.name}, {len(trial.scores)} of {runs} runs; reference: {reference}.",
    ]
    if trial.form:
        lines += ["", f"Graded is `{trial.callable}`: {trial.form}."]
    if trial.settings:
        lines += ["", "Settings of the file and of the scenario:", "", *(f"- {each}" for each in trial.settings)]
    if grade.reasons:
        lines += ["", "Why it has not passed:" if grade.is_graded else "Why it is not graded:", ""]
        lines += [f"- {reason}" for reason in grade.reasons]
    if grade.reference is not None:
        figures = (
            ("ATE [m]", grade.ate_m, grade.reference.ate),
            ("NEES/3 (consistent: 1)", grade.nees, grade.reference.nees),
            ("sigma of the position", None, grade.reference.sigma_position),
            ("sigma of the heading", None, grade.reference.sigma_heading),
        )
        lines += ["", f"| metric | value | divided by that of {reference} |", "|---|---|---|"]
        for title, value, ratio in figures:
            lines.append(f"| {title} | {interval_cell(value, '{:.3f}')} | {interval_cell(ratio, '{:.3f}')} |")
        if grade.own_noise is not None:
            ratios = [interval_cell(each, "{:.3f}") for each in (grade.own_noise.ate, grade.own_noise.nees)]
            text = f"ATE is {ratios[0]} times, NEES {ratios[1]} times that of {reference}"
            lines += ["", f"With the noise of the file instead: {text}. Points count the noise of the recording."]
        lines += ["", f"ATE over the causal optimum's: {interval_cell(grade.ratio_to_optimum, '{:.3f}')}."]
    lines += _points(grade.mark)
    if trial.verdicts:
        lines += ["", "Checks (`slamgauge check`):", "", *_verbatim(str(verdicts_table(trial.verdicts)))]
    if trial.no_checks:
        lines += ["", f"The checks (`slamgauge check`) do not apply: {trial.no_checks}."]
    if trial.output:
        lines += ["", "What it printed last:", "", *_verbatim(trial.output)]
    return html.escape("\n".join(lines), quote=False) + "\n"


def _points(mark: Mark) -> list[str]:
    """Return a table of the items of a mark."""
    lines = ["", f"Points: {mark.points:g} of {mark.total:g}", "", "| item | points | of | |", "|---|---|---|---|"]
    for item in mark.items:
        points = f"{item.points:.2f} | {item.most:.2f}" if item.is_judged else "- | -"
        lines.append(f"| {item.name} | {points} | {item.text.replace('|', '/')} |")
    return lines


def _verbatim(text: str) -> list[str]:
    """Return indented lines, so that no text of a submission ends the block."""
    return [f"    {line}" for line in text.splitlines()]
