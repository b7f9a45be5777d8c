"""Pages of grades: one of all submissions, and one of each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from slamgauge.compare.checks.examination import CHECKS
from slamgauge.compare.grading.grade_output import Row, grade_table, verdict
from slamgauge.compare.report.page import Line, Page, Section, origin, said
from slamgauge.compare.scoring.table import Cell, Head, Table, figure
from slamgauge.compare.storage.files import read_csv, read_json
from slamgauge.compare.storage.result_files import GRADES, GRADESCOPE, PAGES, REPORT, RESULTS

CHECK_HEADS = (
    Head("check", help="property of every right filter; slamgauge check runs all checks", words=True),
    Head("measured quantity", help="size of the violation", words=True),
    Head("usual cause", help="part of the filter that usually contains the mistake", words=True),
    Head("failed by", help="submissions that fail the check", words=True),
)
ITEM_HEADS = (
    Head("item", help="accuracy, consistency, or a check", words=True),
    Head("points", help="points of the submission; none if the item is not judged"),
    Head("of", help="points of a right filter"),
    Head("reason", help="figure of the item, or the part of the filter that usually causes the failure", words=True),
)


def grade_pages(folder: Path) -> dict[str, Page]:
    """Return the pages of the results of `grade` in a folder: of all submissions and of each."""
    rows: list[Row] = [*read_csv(folder / GRADES)]
    graded, passed = (sum(row[key] == "true" for row in rows) for key in ("graded", "passed"))
    lists = {
        "Reasons": [Line(row["submission"], f"{verdict(row)}: {row['reason']}") for row in rows if row["reason"]],
        "Settings of files": [Line(row["submission"], row["settings"]) for row in rows if row["settings"]],
        "Remarks for the teacher": [Line(row["submission"], row["remarks"]) for row in rows if row["remarks"]],
    }
    page = Page(
        kind="grades",
        title=f"{passed} of {len(rows)} submissions passed",
        lead=said(["all could be graded" if graded == len(rows) else f"{len(rows) - graded} could not be graded"]),
        sections=[
            Section("Submissions", "submissions", tables=[grade_table(rows, linked=True)]),
            Section("Failed checks", "failures", tables=[check_table(rows)]),
            *(Section(f"{title} ({len(lines)})", lines=lines, is_folded=True) for title, lines in lists.items()),
        ],
        origin=origin(rows[0]),
    )
    return {REPORT: page} | {f"{PAGES}/{row['submission']}.html": submission_page(folder, row) for row in rows}


def check_table(rows: list[Row]) -> Table:
    """Return a table of the checks that any of these submissions fails."""
    cells: list[list[Cell]] = []
    for check in CHECKS:
        failed = [row["submission"] for row in rows if check.name in row["failed_checks"].split()]
        if failed:
            cells.append([*map(Cell, (check.name, check.figure, check.blame, ", ".join(failed)))])
    return Table(CHECK_HEADS, cells, id="checks")


def submission_page(folder: Path, row: Row) -> Page:
    """Return the page of a submission, for its author: without remarks for the teacher."""
    results: dict[str, Any] = read_json(folder / GRADESCOPE / row["submission"] / RESULTS)
    items = [
        [
            Cell(each["name"]),
            figure(each["score"] if "status" in each else None, "{:.2f}"),
            figure(each["max_score"] if "status" in each else None, "{:.2f}"),
            Cell(each["output"]),
        ]
        for each in results["tests"]
    ]
    points = f"{results['score']:g} of {results['max_score']:g} points"
    return Page(
        kind="a submission",
        title=f"{row['submission']}: {verdict(row)}, {points}",
        lead=said(results["output"].splitlines()),
        notes=said(filter(None, row["settings"].split("; "))),
        sections=[
            Section("Figures", "figures", tables=[grade_table([row])]),
            Section("Points", "points", tables=[Table(ITEM_HEADS, items, id="items")]),
            Section("What it printed last", "printed", verbatim=results["extra_data"]["printed"]),
        ],
        origin=origin(row),
        back=f"../{REPORT}",
    )
