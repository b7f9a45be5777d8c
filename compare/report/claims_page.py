"""The page of the practical's conclusions, each with its evidence."""

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
    Head("claim", "its name in claims.json", words=True),
    Head("section", "of the practical", words=True),
    Head("the practical", "its conclusion, in a few words", words=True),
    Head("hypothesis", "the same as a statement about a ratio of two figures of the same run", words=True),
    Head("verdict", f"holds or does not hold, all of them right with {1 - ALPHA:.0%}; or undecided", words=True),
    Head("ratio", "its geometric mean over runs"),
    Head("interval", "of the ratio; all hold at once, after any number of runs"),
    Head("p", "that the verdict is wrong, for all claims and after any number of runs"),
    Head("avoidable", "share of the filter's error that the causal optimum does not have"),
    Head("runs", "until it was decided, or all"),
    Head("decidable", f"how far from an end of its range a ratio is decided with {POWER:.0%} after the most runs"),
)


def claims_page(folder: Path) -> dict[str, str]:
    """The page of what `claims` has written into a folder."""
    found: list[dict[str, Any]] = read_json(folder / CLAIMS, "claims")
    counts = Counter(each["verdict"] for each in found)
    digests = {f"Digest of {each['setting']}": each["digest"] for each in found if "digest" in each}
    text = plain_page(
        kind="claims",
        title="The practical's conclusions, put to the test",
        lead=[(f"{counts[verdict]} of {len(found)}", verdict) for verdict in ("holds", "does not hold", "undecided")],
        notes=doubts(found),
        tables=[claims_table(found)],
        origin=origin(folder / CLAIMS, {**found[0], "digest": None}, [*digests.items()]),
    )
    return {REPORT: text}


def claims_table(found: list[dict[str, Any]]) -> Table:
    """A row for each claim."""
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
    """Whether the optimum of any claim is in doubt."""
    if not any(each["optimum_check_share"] for each in found):
        return []
    return [f"{MARK} the causal optimum of this setting is in doubt in some of the runs"]
