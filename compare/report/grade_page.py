"""Pages of grades: one of all submissions, and one of each."""

from __future__ import annotations

import html
from pathlib import Path
from urllib.parse import quote

from slamgauge.compare.checks.examination import CHECKS as ALL_CHECKS
from slamgauge.compare.report.page import render
from slamgauge.compare.report.page_elements import Line, Page, Section, origin, said
from slamgauge.compare.scoring.table import Cell, Head, Table, figure
from slamgauge.compare.storage.files import read_csv
from slamgauge.compare.storage.result_files import GRADES, PAGES, REPORT

FIGURES = (
    ("ate_m", "ATE [m]", "RMS position error, mean over runs", "{:.3f}"),
    ("ate_ratio", "ATE x reference", "ATE divided by that of the reference on the same runs", "{:.3f}"),
    ("nees_per_dof", "NEES/3", "mean pose NEES divided by 3: 1 if the covariance is right", "{:.2f}"),
    ("nees_ratio", "NEES x reference", "NEES divided by that of the reference", "{:.2f}"),
    ("sigma_position_ratio", "sigma x reference", "position sigma divided by that of the reference", "{:.3f}"),
    ("sigma_heading_ratio", "heading sigma x reference", "heading sigma divided by that of the reference", "{:.3f}"),
    ("own_noise_ate_ratio", "ATE x, own noise", "ATE over the reference's, with the noise of the file", "{:.3f}"),
    ("own_noise_nees_ratio", "NEES x, own noise", "NEES over the reference's, with the noise of the file", "{:.2f}"),
    ("ratio_to_optimum", "ATE x causal optimum", "ATE divided by that of the causal optimum", "{:.3f}"),
)
SUBMISSION = Head("submission", help="file name of the submission", words=True)
REMARKS = Head("remarks", help="remarks for the teacher, without effect on points and verdict", words=True)
VERDICT = Head("verdict", help="passed if no criterion fails", words=True)
CHECK_HEADS = (
    Head("check", help="property of every right filter; slamgauge check runs all checks", words=True),
    Head("measured quantity", help="size of the violation", words=True),
    Head("usual cause", help="part of the filter that usually contains the mistake", words=True),
)
Row = dict[str, str]


def grade_pages(folder: Path) -> dict[str, str]:
    """Return the pages of the results of `grade` in a folder: of all submissions and of each."""
    rows = read_csv(folder / GRADES)
    graded, passed = (sum(row[key] == "true" for row in rows) for key in ("graded", "passed"))
    where = origin(rows[0])
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
            Section("Submissions", "submissions", tables=[class_table(rows)]),
            Section("Failed checks", "failures", tables=[check_table(rows)]),
            *(Section(f"{title} ({len(lines)})", lines=lines, is_folded=True) for title, lines in lists.items()),
        ],
        origin=where,
    )
    pages = {REPORT: render(page)}
    return pages | {f"{PAGES}/{row['submission']}.html": submission_page(folder, row, where) for row in rows}


def verdict(row: Row) -> str:
    """Return the verdict as text."""
    return "passed" if row["passed"] == "true" else "not passed" if row["graded"] == "true" else "not graded"


def class_table(rows: list[Row]) -> Table:
    """Return a table with a row for each submission and a link to its page."""
    points = Head(f"points of {float(rows[0]['max_points']):g}", help="points by the rubric")
    heads = [SUBMISSION, VERDICT, points, REMARKS, *(Head(title, help=meaning) for _, title, meaning, _ in FIGURES)]
    heads += [Head("failed checks", help="number of failed checks"), Head("time [s]", help="median over runs")]
    cells = [
        [
            Cell(row["submission"], link=f"{PAGES}/{quote(row['submission'])}.html"),
            Cell(verdict(row)),
            figure(_number(row, "points"), "{:g}"),
            Cell("see below" if row["remarks"] else "-"),
            *(figure(_number(row, key), form) for key, _, _, form in FIGURES),
            Cell(str(len(row["failed_checks"].split())), len(row["failed_checks"].split())),
            figure(_number(row, "seconds_per_run"), "{:.2f}"),
        ]
        for row in rows
    ]
    return Table(heads, cells, id="grades")


def _number(row: Row, key: str) -> float | None:
    return float(row[key]) if row[key] else None


def check_table(rows: list[Row]) -> Table:
    """Return a table of the checks that any of these submissions fails."""
    failed = {name: [row["submission"] for row in rows if name in row["failed_checks"].split()] for name in CHECKS}
    heads = [*CHECK_HEADS, Head("failed by", help="submissions that fail the check", words=True)]
    cells = [
        [Cell(name), Cell(CHECKS[name].figure), Cell(CHECKS[name].blame), Cell(", ".join(submissions))]
        for name, submissions in failed.items()
        if submissions
    ]
    return Table(heads, cells, id="checks")


CHECKS = {check.name: check for check in ALL_CHECKS}


def submission_page(folder: Path, row: Row, where: list[tuple[str, str, bool]]) -> str:
    """Return the page of a submission."""
    record = folder / PAGES / f"{row['submission']}.md"
    reasons = row["reason"].split("; ") if row["reason"] else []
    printed = html.unescape(record.read_text(encoding="utf-8")) if record.is_file() else ""
    page = Page(
        kind="a submission",
        title=f"{row['submission']}: {verdict(row)}",
        lead=said(reasons or ["no criterion fails"]),
        sections=[
            Section("Failed checks", "failures", tables=[check_table([row])]),
            Section("Complete record", "record", verbatim=printed),
        ],
        origin=where,
        back=f"../{REPORT}",
    )
    return render(page)
