"""Pages of an error budget, of noise and of a sweep: sentences, tables and pictures."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import quote

from slamgauge.compare.noise.tables import noise_table
from slamgauge.compare.report.page import render
from slamgauge.compare.report.page_elements import Line, Page, Section, origin, pictures, said
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import BUDGET, NOISE, REPORT, SWEEP
from slamgauge.compare.studies.budget import notes, read_budget, rung_table, verdict
from slamgauge.compare.studies.sweep import faults, read_sweep, value_table
from slamgauge.compare.studies.sweep import notes as sweep_notes

PICTURES = {
    "budget.png": (
        "Waterfall of the mean squared position error: each bar starts at the end of the previous one",
        "Each bar starts at the end of the previous one; the line in it is its 95 % interval.",
    ),
    "noise.png": (
        "Estimated divided by assumed sigmas with intervals, and the NIS of each landmark before and after",
        "Estimated divided by assumed sigmas, and the NIS of each landmark.",
    ),
    "sweep.png": (
        "Error, consistency, reported sigma and size of the map against the value, with 95 % intervals",
        "Error, consistency, reported sigma and size of the map against the value; bars are 95 % intervals.",
    ),
}


def budget_page(folder: Path) -> dict[str, str]:
    """Return the page of the results of `budget` in a folder."""
    budget, content = read_budget(folder), read_json(folder / BUDGET, "budget")
    page = Page(
        kind="an error budget",
        title=f"Where the error of {budget.filter} comes from: {budget.scenario}",
        lead=said([verdict(budget)]),
        notes=said(notes(budget)),
        sections=[
            Section("Parts of the error", "parts", tables=[rung_table(budget)]),
            Section("Figure", "pictures", pictures=pictures(folder, PICTURES)),
        ],
        origin=origin(content, [("Filter", budget.filter), ("Runs", str(budget.runs))]),
    )
    return {REPORT: render(page)}


def noise_page(folder: Path) -> dict[str, str]:
    """Return the page of the results of `noise --out` in a folder."""
    content = read_json(folder / NOISE, "noise")
    found = noise_table(content)
    page = Page(
        kind="the noise of a recording",
        title="Noise estimated from the measurements",
        lead=[Line(row[0].text, row[3].text) for row in found.rows],
        notes=said(content["notes"]),
        sections=[
            Section("Noise of the measurements", "sigmas", tables=[found]),
            Section("Figure", "pictures", pictures=pictures(folder, PICTURES)),
        ],
        origin=origin(content),
    )
    return {REPORT: render(page)}


def sweep_page(folder: Path) -> dict[str, str]:
    """Return the page of the results of `study --sweep` in a folder."""
    sweep, content = read_sweep(folder), read_json(folder / SWEEP, "study --sweep")
    digests = [(f"Digest at {value}", each.digest) for value, each in zip(sweep.values, sweep.summaries, strict=True)]
    links = {value: f"{quote(f'{sweep.key}={value}')}/{REPORT}" for value in sweep.values}
    page = Page(
        kind="a sweep",
        title=f"{sweep.scenario} over {sweep.key}, {sweep.runs} runs at each value",
        lead=[Line(*each) for each in faults(sweep).items()],
        notes=said(["each value in the table links to the page of its study, with all runs", *sweep_notes(sweep)]),
        sections=[
            Section("Values", "values", tables=[value_table(sweep, links)]),
            Section("Figure", "pictures", pictures=pictures(folder, PICTURES)),
        ],
        origin=origin(content, [("Runs at each value", str(sweep.runs)), *digests]),
    )
    return {REPORT: render(page)}
