"""Page of a sweep: a study at each value of a key."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import quote

from slamgauge.compare.estimators.registry import CAUSAL
from slamgauge.compare.report.glossary import ESTIMATOR, figure_heads
from slamgauge.compare.report.page_elements import Cell, Head, Table, origin, pictures
from slamgauge.compare.report.plain_page import interval_of, plain_page
from slamgauge.compare.scoring.catalogue import RELATIVE, columns
from slamgauge.compare.scoring.optimum_notes import MARK
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import REPORT, SUMMARY, SWEEP

PICTURES = {
    "sweep.png": (
        "Error, consistency, reported sigma and size of the map against the value, with 95 % intervals",
        "Error, consistency, reported sigma and size of the map against the value; bars are 95 % intervals.",
    )
}


def sweep_page(folder: Path) -> dict[str, str]:
    """Return the page of the results of `study --sweep` in a folder."""
    content = read_json(folder / SWEEP, "study --sweep")
    bounded = any("bound" in point["summary"] for point in content["points"])
    found, rows = columns("sweep", bounded=bounded), list[list[Cell]]()
    links = {value: f"{quote(study.name)}/{REPORT}" for value, study in studies_of(folder, content).items()}
    for point in content["points"]:
        marks = dict.fromkeys(RELATIVE, MARK * (CAUSAL in point["in_doubt"]))
        for name, entry in point["summary"]["estimators"].items():
            figures = [interval_of(entry[key], form, marks.get(key, "")) for _, key, form in found]
            value = str(point["value"])
            rows.append([Cell(value, link=links.get(value, "")), Cell(name), *figures])
    swept = Head(content["key"], "value of this key of the scenario", words=True)
    heads = [swept, ESTIMATOR, *figure_heads("sweep", bounded=bounded)]
    digests = [(f"Digest at {point['value']}", point["summary"]["digest"]) for point in content["points"]]
    text = plain_page(
        kind="a sweep",
        title=f"{content['scenario']} over {content['key']}, {content['runs']} runs at each value",
        lead=[*content["faults"].items()],
        notes=["each value in the table links to the page of its study, with all runs", *content["notes"]],
        tables=[Table("sweep", "Means over runs, with half the width of their 95 % intervals", heads, rows)],
        pictures=pictures(folder, PICTURES),
        origin=origin(folder / SWEEP, content, [("Runs at each value", str(content["runs"])), *digests]),
    )
    return {REPORT: text}


def studies_of(folder: Path, content: dict[str, Any]) -> dict[str, Path]:
    """Return the existing folders of the studies of a sweep by value; `content` is the content of sweep.json."""
    values = [str(point["value"]) for point in content["points"]]
    found = {value: folder / f"{content['key']}={value}" for value in values}
    return {value: study for value, study in found.items() if (study / SUMMARY).is_file()}
