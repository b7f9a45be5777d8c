"""The page of the noise that a recording supports."""

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
        "Sigmas found over those assumed with their intervals, and how the innovations fit before and after",
        "What was found, over what was assumed, and how the innovations fit.",
    )
}
HEADS = (
    Head("noise", "of which measurement", words=True),
    Head("unit", "of what is found", words=True),
    Head("assumed", "the sigma that the recording states"),
    Head("found", "the likeliest value"),
    Head("95 % interval", "of the profile likelihood; an end that is missing the log does not have"),
    Head("verdict", "what the interval says of what is assumed", words=True),
)
NIS = (
    Head("channel", "what is measured", words=True),
    Head("NIS as assumed", "innovations over their variance, with the noise that the recording states; 1 when right"),
    Head("NIS as found", "the same with the likeliest noise"),
    Head("95 % band", "where a right noise would have it"),
    Head("rows", "how many innovations there are"),
)


def noise_page(folder: Path) -> dict[str, str]:
    """The page of what `noise --out` has written into a folder."""
    content = read_json(folder / NOISE, "noise")
    sigmas = [_parameter(name, each) for name, each in content["parameters"].items()]
    lead = [(row[0].text, row[-1].text) for row in sigmas]
    text = plain_page(
        kind="the noise of a recording",
        title="Which noise the measurements support",
        lead=lead,
        notes=content["notes"],
        tables=[
            Table("noise", "Noise of the measurements", HEADS, sigmas),
            Table("systematic", "Systematic errors", HEADS[:2] + HEADS[3:], _systematic(content["systematic"])),
            Table("nis", "How the innovations fit", NIS, [_nis(*each) for each in content["nis_by_channel"].items()]),
        ],
        pictures=pictures(folder, PICTURES),
        origin=origin(folder / NOISE, content),
    )
    return {REPORT: text}


def _parameter(name: str, found: dict[str, Any]) -> list[Cell]:
    said = verdict(supported(found["sigma"], found), found["assumed"])
    return [
        *(Cell(name), Cell(found["unit"])),
        *(figure_cell(found["assumed"], "{:.4g}"), figure_cell(found["sigma"], "{:.4g}")),
        *(Cell(from_to(found["low"], found["high"], "{:.4g}"), found["low"]), Cell(said)),
    ]


def _systematic(found: dict[str, Any]) -> list[list[Cell]]:
    rows: list[list[Cell]] = []
    for name, each in found.items():
        interval = Cell(from_to(each["low"], each["high"], "{:.3g}"), each["low"])
        said = Cell(systematic_verdict(supported(each["value"], each, -math.inf)))
        rows.append([Cell(name), Cell(each["unit"]), figure_cell(each["value"], "{:+.3g}"), interval, said])
    return rows


def _nis(channel: str, found: dict[str, Any]) -> list[Cell]:
    return [
        Cell(channel),
        *(figure_cell(found[key], "{:.3f}") for key in ("before", "after")),
        Cell(from_to(found["low"], found["high"], "{:.3f}"), found["low"]),
        Cell(str(found["rows"]), found["rows"]),
    ]
