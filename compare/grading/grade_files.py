"""The files of grades: a table for spreadsheets, JUnit XML, and a page for each submission."""

from __future__ import annotations

import csv
from pathlib import Path
from xml.etree import ElementTree

from slamgauge.compare.checks.examination import verdicts_table
from slamgauge.compare.grading.grade_table import verdict
from slamgauge.compare.grading.grades import Grade
from slamgauge.compare.grading.grading import Grades
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.text_table import interval_cell
from slamgauge.compare.storage.best_effort import Drawing, decorate
from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.provenance import origin
from slamgauge.compare.storage.result_files import GRADES, GRADES_XML, PAGES
from slamgauge.compare.storage.safe_names import shown


def write_grades(folder: Path, grades: Grades) -> None:
    """Write grades.csv and grades.xml into a folder that exists.

    Raises:
        UserError: a file cannot be written.
    """
    rows = [{key: value for key, value in row.items() if key != "scenario_text"} for row in grades.to_json()]
    with explained(folder, "written"):
        with (folder / GRADES).open("w", encoding="utf-8", newline="") as file:
            table = csv.DictWriter(file, rows[0])
            table.writeheader()
            table.writerows({key: _plain(value) for key, value in row.items()} for row in rows)
        ElementTree.ElementTree(_junit(grades)).write(folder / GRADES_XML, encoding="utf-8", xml_declaration=True)


def write_pages(out: Path, grades: Grades) -> bool:
    """Write a page for each submission beside the grades in `out`; whether all could be written."""

    def writes(each: Grade) -> Drawing:
        def write(stage: Path) -> None:
            (stage / PAGES).mkdir(exist_ok=True)
            (stage / PAGES / f"{each.submission}.md").write_text(page(each, grades), encoding="utf-8")

        return write

    pages = {f"{PAGES}/{each.submission}": writes(each) for each in grades.grades}
    return decorate(out, GRADES, pages, [f"{name}.md" for name in pages])


def page(grade: Grade, grades: Grades) -> str:
    """What there is to say to whoever wrote it, in Markdown."""
    trial = grade.trial
    lines = [
        f"# {grade.submission}: {verdict(grade)}",
        "",
        f"{grades.scenario}, {len(trial.scores)} of {grades.runs} runs; reference: {grades.reference}.",
    ]
    if trial.form:
        lines += ["", f"Graded is `{trial.callable}`: {trial.form}."]
    if grade.reasons:
        lines += ["", "Why it has not passed:" if grade.is_graded else "Why it is not graded:", ""]
        lines += [f"- {reason}" for reason in grade.reasons]
    if grade.reference is not None:
        lines += ["", *_figures(grade, grades.reference)]
    if trial.verdicts:
        lines += ["", "The laws (`slamgauge check`):", "", *_verbatim(str(verdicts_table(trial.verdicts)))]
    if trial.no_laws:
        lines += ["", f"The laws (`slamgauge check`) do not judge it: {trial.no_laws}."]
    if trial.said:
        lines += ["", "What it printed last:", "", *_verbatim(trial.said)]
    return "\n".join(lines) + "\n"


def _figures(grade: Grade, reference: str) -> list[str]:
    found = grade.reference
    assert found is not None
    rows: list[tuple[str, Interval | None, Interval | None]] = [
        ("ATE [m]", grade.ate_m, found.ate),
        ("NEES/3 (consistent: 1)", grade.nees, found.nees),
        ("sigma of the position", None, found.sigma_position),
        ("sigma of the heading", None, found.sigma_heading),
    ]
    lines = [f"| figure | of yours | over that of {reference} |", "|---|---|---|"]
    lines += [f"| {name} | {interval_cell(own, '{:.3f}')} | {interval_cell(x, '{:.3f}')} |" for name, own, x in rows]
    return [*lines, "", f"ATE over the causal optimum's: {interval_cell(grade.ratio_to_optimum, '{:.3f}')}."]


def _verbatim(text: str) -> list[str]:
    """Indented: no text of theirs ends the block."""
    return [f"    {line}" for line in text.splitlines()]


def _junit(grades: Grades) -> ElementTree.Element:
    failures = sum(each.is_graded and not each.passed for each in grades.grades)
    errors = sum(not each.is_graded for each in grades.grades)
    counts = {"tests": str(len(grades.grades)), "failures": str(failures), "errors": str(errors)}
    suite = ElementTree.Element("testsuite", {"name": f"slamgauge grade {grades.scenario}", **counts})
    properties = ElementTree.SubElement(suite, "properties")
    for name, value in origin(grades.scenario_text).items():
        if value is not None:
            ElementTree.SubElement(properties, "property", name=name, value=value)
    for each in grades.grades:
        seconds = sum(score.seconds_total or 0.0 for score in each.trial.scores)
        case = ElementTree.SubElement(
            suite, "testcase", classname=shown(grades.folder.name), name=each.submission, time=f"{seconds:.3f}"
        )
        if each.reasons:
            kind = "failure" if each.is_graded else "error"
            ElementTree.SubElement(case, kind, message="; ".join(each.reasons))
    return suite


def _plain(value: object) -> object:
    """As spreadsheets read it."""
    return str(value).lower() if isinstance(value, bool) else value
