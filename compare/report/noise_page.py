"""Page of the noise estimated from a recording."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from slamgauge.compare.noise.noise_json import supported
from slamgauge.compare.noise.report_text import systematic_verdict, verdict
from slamgauge.compare.report.page_elements import Cell, Head, Table, origin, pictures
from slamgauge.compare.report.plain_page import figure_cell, from_to, plain_page
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import NOISE, REPORT

PICTURES = {
    "noise.png": (
        "Estimated divided by assumed sigmas with intervals, and the fit of innovations before and after",
        "Estimated divided by assumed sigmas, and the fit of the innovations.",
    )
}
HEADS = (
    Head("noise", "measurement", words=True),
    Head("unit", "unit of the value", words=True),
    Head("assumed", "sigma in the recording"),
    Head("found", "maximum likelihood value"),
    Head("95 % interval", "interval of the profile likelihood; the log does not determine a missing end"),
    Head("verdict", "comparison of the interval with the assumed value", words=True),
)
NIS = (
    Head("channel", "measured value", words=True),
    Head("NIS as assumed", "squared innovations divided by their variance, with the assumed noise; 1 if right"),
    Head("NIS as found", "the same with the estimated noise"),
    Head("95 % band", "interval of the NIS for the right noise"),
    Head("rows", "number of innovations"),
)


def noise_page(folder: Path) -> dict[str, str]:
    """Return the page of the results of `noise --out` in a folder."""
    content = read_json(folder / NOISE, "noise")
    sigmas = [_parameter(name, each) for name, each in content["parameters"].items()]
    lead = [(row[0].text, row[-1].text) for row in sigmas]
    text = plain_page(
        kind="the noise of a recording",
        title="Noise estimated from the measurements",
        lead=lead,
        notes=content["notes"],
        tables=[
            Table("noise", "Noise of the measurements", HEADS, sigmas),
            Table("systematic", "Systematic errors", HEADS[:2] + HEADS[3:], _systematic(content["systematic"])),
            Table("nis", "Fit of the innovations", NIS, [_nis(*each) for each in content["nis_by_channel"].items()]),
        ],
        pictures=pictures(folder, PICTURES),
        origin=origin(folder / NOISE, content),
    )
    return {REPORT: text}


def _parameter(name: str, found: dict[str, Any]) -> list[Cell]:
    text = verdict(supported(found["sigma"], found), found["assumed"])
    return [
        *(Cell(name), Cell(found["unit"])),
        *(figure_cell(found["assumed"], "{:.4g}"), figure_cell(found["sigma"], "{:.4g}")),
        *(Cell(from_to(found["low"], found["high"], "{:.4g}"), found["low"]), Cell(text)),
    ]


def _systematic(found: dict[str, Any]) -> list[list[Cell]]:
    rows: list[list[Cell]] = []
    for name, each in found.items():
        interval = Cell(from_to(each["low"], each["high"], "{:.3g}"), each["low"])
        text = Cell(systematic_verdict(supported(each["value"], each, -math.inf)))
        rows.append([Cell(name), Cell(each["unit"]), figure_cell(each["value"], "{:+.3g}"), interval, text])
    return rows


def _nis(channel: str, found: dict[str, Any]) -> list[Cell]:
    return [
        Cell(channel),
        *(figure_cell(found[key], "{:.3f}") for key in ("before", "after")),
        Cell(from_to(found["low"], found["high"], "{:.3f}"), found["low"]),
        Cell(str(found["rows"]), found["rows"]),
    ]
