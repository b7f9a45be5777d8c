"""Pages of an error budget, of noise and of a sweep: sentences, tables and pictures."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any
from urllib.parse import quote

from slamgauge.compare.estimators.registry import CAUSAL
from slamgauge.compare.noise.noise_json import supported
from slamgauge.compare.noise.report_text import systematic_verdict, verdict
from slamgauge.compare.report.page import plain_page
from slamgauge.compare.report.page_elements import origin, pictures
from slamgauge.compare.report.tables import (
    ESTIMATOR,
    Cell,
    Head,
    Table,
    figure_cell,
    figure_heads,
    from_to,
    interval_of,
)
from slamgauge.compare.scoring.catalogue import RELATIVE, columns
from slamgauge.compare.scoring.optimum_notes import MARK
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import BUDGET, NOISE, REPORT, SUMMARY, SWEEP
from slamgauge.compare.studies.budget import RUNGS

BUDGET_PICTURES = {
    "budget.png": (
        "Waterfall of the mean squared position error: each bar starts at the end of the previous one",
        "Each bar starts at the end of the previous one; the line in it is its 95 % interval.",
    )
}
BUDGET_HEADS = (
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
    rows = [
        [
            *(Cell(rung["name"]), Cell(RUNGS.get(rung["name"], "")), figure_cell(rung["mse_m2"], "{:.5f}")),
            figure_cell(added["mean"], "{:+.5f}", MARK if rung["in_doubt"] else ""),
            from_to(added["low"], added["high"], "{:+.5f}"),
            figure_cell(added["mean"] / total if total else None, "{:.0%}"),
        ]
        for rung in content["rungs"]
        for added in [rung["increment_m2"]]
    ]
    text = plain_page(
        kind="an error budget",
        title=f"Where the error of {content['filter']} comes from: {content['scenario']}",
        lead=[("", content["verdict"])],
        notes=content["notes"],
        tables=[Table("budget", "Rung by rung", BUDGET_HEADS, rows)],
        pictures=pictures(folder, BUDGET_PICTURES),
        origin=origin(content, [("Filter", content["filter"]), ("Runs", str(content["runs"]))]),
    )
    return {REPORT: text}


NOISE_PICTURES = {
    "noise.png": (
        "Estimated divided by assumed sigmas with intervals, and the fit of innovations before and after",
        "Estimated divided by assumed sigmas, and the fit of the innovations.",
    )
}
NOISE_HEADS = (
    Head("noise", "measurement", words=True),
    Head("unit", "unit of the value", words=True),
    Head("assumed", "sigma in the recording"),
    Head("found", "maximum likelihood value"),
    Head("95 % interval", "interval of the profile likelihood; the log does not determine a missing end"),
    Head("verdict", "comparison of the interval with the assumed value", words=True),
)
NIS_HEADS = (
    Head("channel", "measured value", words=True),
    Head("NIS as assumed", "squared innovations divided by their variance, with the assumed noise; 1 if right"),
    Head("NIS as found", "the same with the estimated noise"),
    Head("95 % band", "interval of the NIS for the right noise"),
    Head("rows", "number of innovations"),
)


def noise_page(folder: Path) -> dict[str, str]:
    """Return the page of the results of `noise --out` in a folder."""
    content = read_json(folder / NOISE, "noise")
    sigmas = [
        [
            *(Cell(name), Cell(each["unit"])),
            *(figure_cell(each["assumed"], "{:.4g}"), figure_cell(each["sigma"], "{:.4g}")),
            from_to(each["low"], each["high"], "{:.4g}"),
            Cell(verdict(supported(each["sigma"], each), each["assumed"])),
        ]
        for name, each in content["parameters"].items()
    ]
    systematic = [
        [
            *(Cell(name), Cell(each["unit"]), figure_cell(each["value"], "{:+.3g}")),
            from_to(each["low"], each["high"], "{:.3g}"),
            Cell(systematic_verdict(supported(each["value"], each, -math.inf))),
        ]
        for name, each in content["systematic"].items()
    ]
    nis = [
        [
            *(Cell(channel), figure_cell(each["before"], "{:.3f}"), figure_cell(each["after"], "{:.3f}")),
            *(from_to(each["low"], each["high"], "{:.3f}"), Cell(str(each["rows"]), each["rows"])),
        ]
        for channel, each in content["nis_by_channel"].items()
    ]
    text = plain_page(
        kind="the noise of a recording",
        title="Noise estimated from the measurements",
        lead=[(row[0].text, row[-1].text) for row in sigmas],
        notes=content["notes"],
        tables=[
            Table("noise", "Noise of the measurements", NOISE_HEADS, sigmas),
            Table("systematic", "Systematic errors", NOISE_HEADS[:2] + NOISE_HEADS[3:], systematic),
            Table("nis", "Fit of the innovations", NIS_HEADS, nis),
        ],
        pictures=pictures(folder, NOISE_PICTURES),
        origin=origin(content),
    )
    return {REPORT: text}


SWEEP_PICTURES = {
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
        pictures=pictures(folder, SWEEP_PICTURES),
        origin=origin(content, [("Runs at each value", str(content["runs"])), *digests]),
    )
    return {REPORT: text}


def studies_of(folder: Path, content: dict[str, Any]) -> dict[str, Path]:
    """Return the existing folders of the studies of a sweep by value; `content` is the content of sweep.json."""
    values = [str(point["value"]) for point in content["points"]]
    found = {value: folder / f"{content['key']}={value}" for value in values}
    return {value: study for value, study in found.items() if (study / SUMMARY).is_file()}
