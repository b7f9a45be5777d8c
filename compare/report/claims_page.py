"""Page of the conclusions of the exercise, each with its evidence."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

from slamgauge.compare.report.page_elements import Cell, Head, Table, origin
from slamgauge.compare.report.plain_page import figure_cell, from_to, plain_page
from slamgauge.compare.scoring.confidence_sequence import POWER
from slamgauge.compare.scoring.optimum_notes import MARK
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import CLAIMS, REPORT
from slamgauge.compare.studies.claim_evidence import ALPHA

HEADS = (
    Head("claim", "name of the claim in claims.json", words=True),
    Head("section", "section of the exercise", words=True),
    Head("conclusion", "short form of the conclusion of the exercise", words=True),
    Head("hypothesis", "the conclusion as a statement about a ratio of two metrics of the same run", words=True),
    Head("verdict", f"holds, does not hold or undecided; all are right with probability {1 - ALPHA:.0%}", words=True),
    Head("ratio", "geometric mean over runs"),
    Head("interval", "simultaneous confidence interval of the ratio, valid after any number of runs"),
    Head("p", "p-value of the verdict, corrected for all claims and any number of runs"),
    Head("avoidable", "share of the filter's error above that of the causal optimum"),
    Head("runs", "runs until the decision, or all runs"),
    Head("decidable", f"distance of a ratio from its range that all runs decide with probability {POWER:.0%}"),
)


def claims_page(folder: Path) -> dict[str, str]:
    """Return the page of the results of `claims` in a folder."""
    found: list[dict[str, Any]] = read_json(folder / CLAIMS, "claims")
    counts = Counter(each["verdict"] for each in found)
    digests = {f"Digest of {each['setting']}": each["digest"] for each in found if "digest" in each}
    text = plain_page(
        kind="claims",
        title="Tests of the conclusions of the exercise",
        lead=[(f"{counts[verdict]} of {len(found)}", verdict) for verdict in ("holds", "does not hold", "undecided")],
        notes=doubts(found),
        tables=[claims_table(found)],
        origin=origin(folder / CLAIMS, {**found[0], "digest": None}, [*digests.items()]),
    )
    return {REPORT: text}


def claims_table(found: list[dict[str, Any]]) -> Table:
    """Return a table with a row for each claim."""
    rows: list[list[Cell]] = []
    for each in found:
        p, mark = each["p_value"], MARK if each["optimum_check_share"] else ""
        rows.append(
            [
                *(Cell(each[key]) for key in ("id", "section", "claim", "hypothesis", "verdict")),
                figure_cell(each["effect"], "{:.3g}"),
                Cell(from_to(each["low"], each["high"], "{:.3g}"), each["low"]),
                Cell("< 0.0001" if p < 1e-4 else f"{p:.4f}", p),
                figure_cell(each["optimum"], "{:.0%}", mark),
                Cell(str(each["runs"]), each["runs"]),
                figure_cell(each["decidable"], "x {:.3f}"),
            ]
        )
    return Table("claims", "Claims and their evidence", HEADS, rows)


def doubts(found: list[dict[str, Any]]) -> list[str]:
    """Return a note if the optimum of any claim is in doubt."""
    if not any(each["optimum_check_share"] for each in found):
        return []
    return [f"{MARK} the causal optimum of this setting is in doubt in some of the runs"]
