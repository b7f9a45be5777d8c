"""The page of a sweep: a study at each value of a key."""

from __future__ import annotations

from pathlib import Path

from slamgauge.compare.estimators.registry import CAUSAL
from slamgauge.compare.report.content import Cell, Head, Table, origin, pictures
from slamgauge.compare.report.glossary import figure_heads
from slamgauge.compare.report.plain_page import interval_of, plain_page
from slamgauge.compare.scoring.catalogue import RELATIVE, columns
from slamgauge.compare.scoring.optimum_notes import MARK
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import REPORT, SWEEP

PICTURES = {
    "sweep.png": (
        "Error, consistency, reported sigma and size of the map against the value, with 95 % intervals",
        "Error, consistency, reported sigma and size of the map against the value; bars are 95 % intervals.",
    )
}


def sweep_page(folder: Path) -> dict[str, str]:
    """The page of what `study --sweep` has written into a folder."""
    content = read_json(folder / SWEEP, "study --sweep")
    bounded = any("bound" in point["summary"] for point in content["points"])
    found, rows = columns("sweep", bounded=bounded), list[list[Cell]]()
    for point in content["points"]:
        marks = dict.fromkeys(RELATIVE, MARK * (CAUSAL in point["in_doubt"]))
        for name, entry in point["summary"]["estimators"].items():
            figures = [interval_of(entry[key], form, marks.get(key, "")) for _, key, form in found]
            rows.append([Cell(str(point["value"])), Cell(name), *figures])
    heads = [Head(content["key"], words=True), Head("estimator", words=True), *figure_heads("sweep", bounded=bounded)]
    text = plain_page(
        kind="a sweep",
        title=f"{content['scenario']} over {content['key']}, {content['runs']} runs at each value",
        lead=[*content["faults"].items()],
        notes=content["notes"],
        tables=[Table("sweep", "Means over runs, with the half width of their 95 % intervals", heads, rows)],
        pictures=pictures(folder, PICTURES),
        origin=origin(folder / SWEEP, content, [("Runs at each value", str(content["runs"]))]),
    )
    return {REPORT: text}
