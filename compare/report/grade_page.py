"""The pages of grades: one of the class, and one of each submission."""

from __future__ import annotations

import csv
from pathlib import Path
from urllib.parse import quote

from slamgauge.compare.checks.examination import LAWS
from slamgauge.compare.report.page_elements import Cell, Head, Table, origin
from slamgauge.compare.report.plain_page import from_to, plain_page
from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.result_files import GRADES, PAGES, REPORT

FIGURES = (
    ("ate_m", "ATE [m]", "RMS position error, mean over runs", "{:.3f}"),
    ("ate_ratio", "ATE x reference", "over that of the reference on the same runs", "{:.3f}"),
    ("nees_per_dof", "NEES/3", "mean pose NEES over 3: 1 when its sigmas are right", "{:.2f}"),
    ("nees_ratio", "NEES x reference", "over that of the reference", "{:.2f}"),
    ("sigma_position_ratio", "sigma x reference", "position sigma that it reports, over the reference's", "{:.3f}"),
    ("sigma_heading_ratio", "heading sigma x reference", "likewise of the heading", "{:.3f}"),
    ("ratio_to_optimum", "ATE x causal optimum", "over that of the causal optimum", "{:.3f}"),
)
SUBMISSION = Head("submission", "as its file is called", words=True)
VERDICT = Head("verdict", "passed where nothing speaks against it", words=True)
WHY = (
    Head("law", "what a right filter does whatever it is; the command slamgauge check has them all", words=True),
    Head("what is measured", "how far from the law it is", words=True),
    Head("what is to blame, as a rule", "the part of a filter whose mistake shows there", words=True),
)
Row = dict[str, str]


def grade_pages(folder: Path) -> dict[str, str]:
    """The pages of what `grade` has written into a folder: the class, and each submission."""
    with explained(folder / GRADES, "read"), (folder / GRADES).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    graded, passed = (sum(row[key] == "true" for row in rows) for key in ("graded", "passed"))
    where = origin(folder / GRADES, rows[0])
    pages = {
        REPORT: plain_page(
            kind="grades",
            title=f"{passed} of {len(rows)} submissions passed",
            lead=[(row["submission"], f"{verdict(row)}: {row['reason']}") for row in rows if row["passed"] != "true"],
            notes=[] if graded == len(rows) else [f"{len(rows) - graded} could not be graded"],
            tables=[class_table(rows), law_table(rows)],
            origin=where,
        )
    }
    return pages | {f"{PAGES}/{row['submission']}.html": submission_page(folder, row, where) for row in rows}


def verdict(row: Row) -> str:
    """In a word or two."""
    return "passed" if row["passed"] == "true" else "not passed" if row["graded"] == "true" else "not graded"


def class_table(rows: list[Row]) -> Table:
    """A row for each submission, which leads to its page."""
    heads = [SUBMISSION, VERDICT, *(Head(*each[1:3]) for each in FIGURES)]
    heads += [Head("laws broken", "how many of those that every filter must obey"), Head("time [s]", "median of a run")]
    cells = [
        [
            Cell(row["submission"], link=f"{PAGES}/{quote(row['submission'])}.html"),
            Cell(verdict(row)),
            *(_figure(row, key, form) for key, _, _, form in FIGURES),
            Cell(str(len(row["failed_laws"].split())), len(row["failed_laws"].split())),
            _figure(row, "seconds_per_run", "{:.2f}"),
        ]
        for row in rows
    ]
    return Table("grades", "The class", heads, cells)


def _figure(row: Row, key: str, form: str) -> Cell:
    return Cell(form.format(float(row[key])), float(row[key])) if row[key] else Cell("-")


def law_table(rows: list[Row]) -> Table:
    """The laws that any of these submissions breaks, and what that means."""
    broken = {name: [row["submission"] for row in rows if name in row["failed_laws"].split()] for name in LAW}
    heads = [*WHY, Head("broken by", "which submissions", words=True)]
    cells = [
        [Cell(name), Cell(LAW[name].figure), Cell(LAW[name].blame), Cell(", ".join(who))]
        for name, who in broken.items()
        if who
    ]
    return Table("laws", "Laws that are broken, and what that means", heads, cells)


LAW = {law.name: law for law in LAWS}


def submission_page(folder: Path, row: Row, where: list[tuple[str, str, bool]]) -> str:
    """What there is to say to whoever wrote a submission."""
    record = folder / PAGES / f"{row['submission']}.md"
    figures = [
        [Cell(title), _figure(row, key, form), Cell(_ends(row, key, form)), Cell(meaning)]
        for key, title, meaning, form in FIGURES
    ]
    heads = [
        Head("figure", "what is measured; its last column says more", words=True),
        *(Head("mean", "over runs"), Head("95 % interval", "of the mean"), Head("what it is", "in words", words=True)),
    ]
    reasons = row["reason"].split("; ") if row["reason"] else []
    return plain_page(
        kind="a submission",
        title=f"{row['submission']}: {verdict(row)}",
        lead=[("", reason) for reason in reasons] or [("", "nothing speaks against it")],
        tables=[Table("figures", "Figures", heads, figures if row["graded"] == "true" else []), law_table([row])],
        origin=where,
        back=f"../{REPORT}",
        verbatim=record.read_text(encoding="utf-8").splitlines() if record.is_file() else (),
    )


def _ends(row: Row, key: str, form: str) -> str:
    low, high = (float(row[end]) if row[end] else None for end in (f"{key}_low", f"{key}_high"))
    return from_to(low, high, form)
