"""Output of grades: one table for terminal and page, and files for spreadsheets and Gradescope."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from slamgauge.compare.grading.grades import FIGURES, Grade
from slamgauge.compare.grading.grading import Grades
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.table import Cell, Head, Page, Table, figure
from slamgauge.compare.storage.files import explained, write_csv, write_json
from slamgauge.compare.storage.result_files import GRADES, GRADESCOPE, PAGES, RESULTS, RUBRIC

Row = Mapping[str, Any]  # a row of `Grade.to_json` or of grades.csv
SUBMISSION = Head("submission", help="file name of the submission", words=True)
VERDICT = Head("verdict", help="passed if no criterion fails", words=True)
FAILED = Head("checks failed", help="number of failed checks")
SECONDS = Head("time [s]", help="time of a run, median over runs")


def grades_page(grades: Grades) -> Page:
    """Return a table with a row for the reference and for each submission, and below it the reasons for failures."""
    of_reference = {"verdict": "reference", "points": None, "failed_checks": None}
    reference = grades.reference.to_json()
    table = grade_table(
        [
            reference | of_reference | {"submission": f"({reference['submission']})"},
            *(each.to_json() for each in grades.grades),
        ]
    )
    reasons = [f"{each.submission}: {'; '.join(each.reasons)}" for each in grades.grades if each.reasons]
    reasons += [
        f"{each.submission}, for the teacher: {'; '.join(each.remarks)}" for each in grades.grades if each.remarks
    ]
    graded, passed = (sum(getattr(each, name) for each in grades.grades) for name in ("is_graded", "passed"))
    return Page((table, *reasons, f"{graded} of {len(grades.grades)} graded, {passed} passed"))


def grade_table(rows: Sequence[Row], *, linked: bool = False) -> Table:
    """Return a table with a row for each submission, `linked` to its page, without columns that have no figure."""
    points = Head("points", f"points of {float(rows[0]['max_points']):g}", "points by the rubric")
    figures = [head for head in FIGURES if any(row[head.key] not in (None, "") for row in rows)]
    cells: list[list[Cell]] = []
    for row in rows:
        intervals = [[_number(row[f"{head.key}{end}"]) for end in ("", "_low", "_high")] for head in figures]
        failed = row["failed_checks"]
        cells.append(
            [
                Cell(row["submission"], link=f"{PAGES}/{quote(row['submission'])}.html" if linked else ""),
                Cell(row.get("verdict") or verdict(row)),
                figure(_number(row["points"]), "{:g}"),
                figure(None if failed is None else len(failed.split()), "{}"),
                *(
                    figure(None if mean is None else Interval(mean, low, high), head.form)
                    for head, (mean, low, high) in zip(figures, intervals, strict=True)
                ),
                figure(_number(row["seconds_per_run"]), "{:.2f}"),
            ]
        )
    return Table([SUBMISSION, VERDICT, points, FAILED, *figures, SECONDS], cells, id="grades")


def verdict(row: Row) -> str:
    """Return the verdict as text."""
    passed, graded = (row[key] in (True, "true") for key in ("passed", "graded"))
    return "passed" if passed else "FAILED" if graded else "not graded"


def _number(value: float | str | None) -> float | None:
    return None if value in (None, "") else float(value)


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
        (folder / RUBRIC).write_text(grades.settings.rubric.to_toml(), encoding="utf-8")
        for each in grades.grades:
            place = folder / GRADESCOPE / each.submission
            place.mkdir(parents=True)
            for path in (place, *([folder] * (len(grades.grades) == 1))):
                write_json(path / RESULTS, gradescope_json(each))


def gradescope_json(grade: Grade) -> dict[str, Any]:
    """Return the content of results.json, which Gradescope's autograder and the page of the submission read.

    Students do not see `extra_data` in Gradescope: remarks for the teacher, and what the submission printed last. An
    item that is not judged has no status.
    """
    mark, trial = grade.mark, grade.trial
    lines = [*grade.reasons] or ["No criterion fails."]
    if trial.form:
        lines.insert(0, f"Graded is {trial.callable}: {trial.form}.")
    if trial.no_checks:
        lines.append(f"The checks do not apply: {trial.no_checks}.")
    tests: list[dict[str, Any]] = []
    for item in mark.items:
        points = {"score": round(item.points, 2), "max_score": round(item.most, 2)}
        status = {"status": "passed" if item.points >= item.most else "failed"} if item.is_judged else {}
        tests.append({"name": item.name, **points, "output": item.text, "visibility": "visible", **status})
    return {
        "score": mark.points,
        "max_score": mark.total,
        "execution_time": round(sum(each["seconds_total"] or 0.0 for each in trial.scores), 3),
        "output": "\n".join(lines),
        "output_format": "text",
        "visibility": "visible",
        "stdout_visibility": "hidden",
        "tests": tests,
        "extra_data": {
            "passed": grade.passed,
            "graded": grade.is_graded,
            "remarks": [*grade.remarks],
            "printed": trial.output,
        },
    }
