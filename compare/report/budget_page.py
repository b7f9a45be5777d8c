"""Page of an error budget."""

from __future__ import annotations

from pathlib import Path

from slamgauge.compare.report.page_elements import Cell, Head, Table, origin, pictures
from slamgauge.compare.report.plain_page import figure_cell, from_to, plain_page
from slamgauge.compare.scoring.optimum_notes import MARK
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import BUDGET, REPORT
from slamgauge.compare.studies.budget import RUNGS

PICTURES = {
    "budget.png": (
        "Waterfall of the mean squared position error: each bar starts at the end of the previous one",
        "Each bar starts at the end of the previous one; the line in it is its 95 % interval.",
    )
}
HEADS = (
    Head("rung", "an estimator on the same measurements, with one disadvantage more than the rung before", words=True),
    Head("for", "the disadvantage that the rung adds", words=True),
    Head("mse [m²]", "mean squared position error over runs and steps"),
    Head("adds [m²]", "increase over the rung before: the largest possible gain there"),
    Head("95 % interval", "interval of the increase, bootstrapped over runs"),
    Head("share", "increase divided by the total error"),
)


def budget_page(folder: Path) -> dict[str, str]:
    """Return the page of the results of `budget` in a folder."""
    content = read_json(folder / BUDGET, "budget")
    total = content["rungs"][-1]["mse_m2"]
    rows: list[list[Cell]] = []
    for rung in content["rungs"]:
        added, mark = rung["increment_m2"], MARK if rung["in_doubt"] else ""
        rows.append(
            [
                Cell(rung["name"]),
                Cell(RUNGS.get(rung["name"], "")),
                figure_cell(rung["mse_m2"], "{:.5f}"),
                figure_cell(added["mean"], "{:+.5f}", mark),
                Cell(from_to(added["low"], added["high"], "{:+.5f}"), added["low"]),
                figure_cell(added["mean"] / total if total else None, "{:.0%}"),
            ]
        )
    text = plain_page(
        kind="an error budget",
        title=f"Where the error of {content['filter']} comes from: {content['scenario']}",
        lead=[("", content["verdict"])],
        notes=content["notes"],
        tables=[Table("budget", "Rung by rung", HEADS, rows)],
        pictures=pictures(folder, PICTURES),
        origin=origin(folder / BUDGET, content, [("Filter", content["filter"]), ("Runs", str(content["runs"]))]),
    )
    return {REPORT: text}
