"""Pages of an error budget, of noise and of a sweep: sentences, tables and pictures."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import quote

from slamgauge.compare.noise.tables import nis_table, noise_table
from slamgauge.compare.report.page import plain_page
from slamgauge.compare.report.page_elements import origin, pictures
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import BUDGET, NOISE, REPORT, SWEEP
from slamgauge.compare.studies.budget import notes, read_budget, rung_table, verdict
from slamgauge.compare.studies.sweep import faults, read_sweep, value_table
from slamgauge.compare.studies.sweep import notes as sweep_notes

BUDGET_PICTURES = {
    "budget.png": (
        "Waterfall of the mean squared position error: each bar starts at the end of the previous one",
        "Each bar starts at the end of the previous one; the line in it is its 95 % interval.",
    )
}


def budget_page(folder: Path) -> dict[str, str]:
    """Return the page of the results of `budget` in a folder."""
    budget, content = read_budget(folder), read_json(folder / BUDGET, "budget")
    text = plain_page(
        kind="an error budget",
        title=f"Where the error of {budget.filter} comes from: {budget.scenario}",
        lead=[("", verdict(budget))],
        notes=notes(budget),
        tables=[rung_table(budget)],
        pictures=pictures(folder, BUDGET_PICTURES),
        origin=origin(content, [("Filter", budget.filter), ("Runs", str(budget.runs))]),
    )
    return {REPORT: text}


NOISE_PICTURES = {
    "noise.png": (
        "Estimated divided by assumed sigmas with intervals, and the fit of innovations before and after",
        "Estimated divided by assumed sigmas, and the fit of the innovations.",
    )
}


def noise_page(folder: Path) -> dict[str, str]:
    """Return the page of the results of `noise --out` in a folder."""
    content = read_json(folder / NOISE, "noise")
    found = noise_table(content)
    text = plain_page(
        kind="the noise of a recording",
        title="Noise estimated from the measurements",
        lead=[(row[0].text, row[3].text) for row in found.rows],
        notes=content["notes"],
        tables=[found, nis_table(content)],
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
    sweep, content = read_sweep(folder), read_json(folder / SWEEP, "study --sweep")
    studies = zip(sweep.values, sweep.summaries, strict=True)
    links = {value: f"{quote(f'{sweep.key}={value}')}/{REPORT}" for value in sweep.values}
    text = plain_page(
        kind="a sweep",
        title=f"{sweep.scenario} over {sweep.key}, {sweep.runs} runs at each value",
        lead=[*faults(sweep).items()],
        notes=["each value in the table links to the page of its study, with all runs", *sweep_notes(sweep)],
        tables=[value_table(sweep, links)],
        pictures=pictures(folder, SWEEP_PICTURES),
        origin=origin(
            content,
            [
                ("Runs at each value", str(sweep.runs)),
                *((f"Digest at {value}", summary.digest) for value, summary in studies),
            ],
        ),
    )
    return {REPORT: text}
