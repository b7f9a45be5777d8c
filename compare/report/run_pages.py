"""Pages of a run, with a replay, and of the noise of a recording."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from slamgauge.compare.estimators.registry import OPTIMA, REGISTRY
from slamgauge.compare.figures.plot_style import DEAD_RECKONING
from slamgauge.compare.noise.tables import noise_table
from slamgauge.compare.report.page import Line, Page, Section, looks, origin, pictures, render, said
from slamgauge.compare.report.replay_data import replay_data
from slamgauge.compare.scoring.comparison import doubtful_kinds, run_table
from slamgauge.compare.scoring.table import ESTIMATOR, Cell, Head, Table, cell, figure
from slamgauge.compare.storage.files import load_results, read_json
from slamgauge.compare.storage.result_files import METRICS, NOISE
from slamgauge.estimate import Kind

LARGEST = 2_950_000  # bytes of a page: 3 MB minus what a browser may add when it saves the page
MOST_CLOSURES = 500  # rows of the table of loop closures
PICTURES = {
    "figure.png": "The map with paths, landmarks and 3-sigma ellipses, and the errors within their 3-sigma bounds.",
    "consistency.png": "The test without ground truth: a filter above the band of simulated twins is overconfident.",
    "noise.png": "Estimated divided by assumed sigmas with intervals, and NIS of each landmark.",
    "rays.png": "How rays of a bearing-only map begin, lose members and become landmarks.",
}
TERMS = (
    ("causal optimum", "best estimate from the measurements up to each step, with the true noise (causal)"),
    ("hindsight optimum", "best estimate from all measurements (batch)"),
    ("3-sigma ellipse", "region that contains the true position with probability 98.9 % if the covariance is right"),
)


def run_page(folder: Path) -> Page:
    """Return the page of the results of `run` or `evaluate --out` in a folder."""
    results, metrics = load_results(folder), read_json(folder / METRICS)
    title, _, recording, estimates = results
    optima: dict[Kind, str] = {each.kind: name for name, each in estimates.items() if OPTIMA.get(each.kind) == name}
    doubtful = doubtful_kinds({kind: estimates[name] for kind, name in optima.items()})
    failures = [f"{each['estimator']} failed: {each['error']}" for each in metrics.get("failures", ())]
    first, *others = [*pictures(folder, PICTURES), None]
    page = Page(
        kind="one run",
        title=title,
        lead=lead(metrics),
        notes=said([*metrics.get("notes", ()), *failures]),
        picture=first,
        sections=[
            Section("Metrics of each estimator", "figures", tables=[run_table(metrics["estimators"], doubtful)]),
            Section("Loop closures: error and sigma before and after", tables=[closure_table(metrics)], is_folded=True),
            Section("Replay of the run", "replay", include="replay.html"),
            Section("Further figures", "pictures", pictures=[each for each in others if each is not None]),
        ],
        looks=looks(estimates, hidden=(DEAD_RECKONING,) if len(estimates) > 1 else ()),
        terms=TERMS,
        origin=origin(metrics, [("Steps", str(recording.steps)), ("Sensor", recording.sensor)]),
    )
    room = LARGEST - len(render(page).encode())
    return replace(page, data={"run": replay_data(results, page.looks, room)})


def lead(metrics: dict[str, Any]) -> list[Line]:
    """Return a sentence for each estimator: its error, its ratio to the optimum, and the verdict."""
    lines: list[Line] = []
    for name, entry in metrics["estimators"].items():
        error, ratio, parts = entry.get("ate_m"), entry.get("ratio_to_optimum"), list[str]()
        if error is not None:
            parts.append(f"RMS position error {cell(error, '{:.3f}')} m")
        if name in OPTIMA.values():
            parts.append(f"the {REGISTRY[name].title}, the reference of {entry['kind']} estimates")
        elif ratio is not None:
            parts.append(f"{cell(ratio, '{:.2f}')} times the {REGISTRY[OPTIMA[entry['kind']]].title}'s")
        parts += filter(None, [entry.get("verdict")])
        lines += [Line(name, f"{'; '.join(parts)}.")] if parts else []
    return lines


def closure_table(metrics: dict[str, Any]) -> Table:
    """Return the table of errors and sigmas before and after loop closures."""
    columns = {
        "error_before_m": Head("error before [m]", help="position error at the step before"),
        "error_after_m": Head("error after [m]", help="position error at the step"),
        "sigma_before_m": Head("sigma before [m]", help="reported position sigma at the step before"),
        "sigma_after_m": Head("sigma after [m]", help="reported position sigma at the step"),
    }
    step = Head("step", help="step of the loop closure: a landmark is re-observed after at least 10 s")
    entries = metrics["estimators"].items()
    closures = [(name, each) for name, entry in entries for each in entry.get("loop_closure") or ()]
    every = max(-(-len(closures) // MOST_CLOSURES), 1)
    rows = [
        [Cell(name), figure(each["step"], "{}"), *(figure(each[key], "{:.3f}") for key in columns)]
        for name, each in closures[::every]
    ]
    which = "each loop closure" if every == 1 else f"1 in {every} loop closures"
    caption = f"Position error and its sigma before and after {which}"
    return Table([ESTIMATOR, step, *columns.values()], rows, caption, "closures")


def noise_page(folder: Path) -> Page:
    """Return the page of the results of `noise --out` in a folder."""
    content = read_json(folder / NOISE)
    found = noise_table(content)
    return Page(
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
