"""Page of a run: summary, tables, figures and replay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from slamgauge.compare.estimators.registry import OPTIMA, REGISTRY
from slamgauge.compare.figures.plot_style import DEAD_RECKONING
from slamgauge.compare.report.page import TERMS, render
from slamgauge.compare.report.page_elements import Line, Page, Section, looks, origin, pictures, said
from slamgauge.compare.report.replay_data import replay_data
from slamgauge.compare.scoring.comparison import doubtful_kinds, run_table
from slamgauge.compare.scoring.table import ESTIMATOR, Cell, Head, Table, cell, figure
from slamgauge.compare.storage.files import Results, load_results, read_json
from slamgauge.compare.storage.result_files import METRICS, REPORT
from slamgauge.estimate import Kind

LARGEST = 2_950_000  # bytes of a page: 3 MB minus what a browser may add when it saves the page
MOST_CLOSURES = 500  # rows of the table of loop closures
PICTURES = {
    "figure.png": (
        "Map of the run with paths, landmarks and 3-sigma ellipses, and the errors in x, y and heading against time",
        "The map, and the errors within their 3-sigma bounds.",
    ),
    "consistency.png": (
        "Expected NEES over 3 of each filter against time, with the band of simulated twins",
        "The test without ground truth: a filter above the band of simulated twins is overconfident there.",
    ),
    "rays.png": (
        "Moments of a bearing-only map: rays begin, lose members and become landmarks",
        "How rays begin, lose members and become landmarks.",
    ),
}
WITH_HISTORY = "maps of {} are those of the shown moment"
WITHOUT_HISTORY = "those of {} are final maps (faint), because no history was stored"


def run_page(folder: Path) -> dict[str, str]:
    """Return the page of the results of `run` or `evaluate --out` in a folder.

    Raises:
        UserError: If the folder has no results, or its files belong to different runs.
    """
    results, path = load_results(folder), folder / METRICS
    title, _, recording, estimates = results
    metrics = read_json(path, "run")
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
        legend=legend(results),
        terms=TERMS["run"],
        origin=origin(metrics, [("Steps", str(recording.steps)), ("Sensor", recording.sensor)]),
    )
    room = LARGEST - len(render(page).encode())
    return {REPORT: render(replace(page, data={"run": replay_data(results, page.looks, room)}))}


def lead(metrics: dict[str, Any]) -> list[Line]:
    """Return a sentence for each estimator: its error, its ratio to the optimum, and the verdict."""
    return [Line(name, f"{text}.") for name, entry in metrics["estimators"].items() if (text := _sentence(name, entry))]


def _sentence(name: str, entry: dict[str, Any]) -> str:
    error, ratio = entry.get("ate_m"), entry.get("ratio_to_optimum")
    parts: list[str] = []
    if error is not None:
        parts.append(f"RMS position error {cell(error, '{:.3f}')} m")
    if name in OPTIMA.values():
        parts.append(f"the {REGISTRY[name].title}, the reference of {entry['kind']} estimates")
    elif ratio is not None:
        optimum = REGISTRY[OPTIMA[entry["kind"]]].title
        parts.append(f"{cell(ratio, '{:.2f}')} times the {optimum}'s")
    if entry.get("verdict"):
        parts.append(entry["verdict"])
    return "; ".join(parts)


def closure_table(metrics: dict[str, Any]) -> Table:
    """Return the table of errors and sigmas before and after loop closures."""
    keys = ("error_before_m", "error_after_m", "sigma_before_m", "sigma_after_m")
    heads = [
        ESTIMATOR,
        Head("step", help="step of the loop closure: a landmark is re-observed after at least 10 s"),
        Head("error before [m]", help="position error at the step before"),
        Head("error after [m]", help="position error at the step"),
        Head("sigma before [m]", help="reported position sigma at the step before"),
        Head("sigma after [m]", help="reported position sigma at the step"),
    ]
    entries = metrics["estimators"].items()
    closures = [(name, each) for name, entry in entries for each in entry.get("loop_closure") or ()]
    every = max(-(-len(closures) // MOST_CLOSURES), 1)
    rows = [
        [Cell(name), Cell(str(closure["step"]), closure["step"])] + [figure(closure[key], "{:.3f}") for key in keys]
        for name, closure in closures[::every]
    ]
    which = "each loop closure" if every == 1 else f"1 in {every} loop closures"
    return Table(heads, rows, f"Position error and its sigma before and after {which}", "closures")


def legend(results: Results) -> str:
    """Return an explanation of the maps in the replay."""
    mapped = {name: each for name, each in results.estimates.items() if len(each.landmark_ids)}
    stored = [name for name, each in mapped.items() if each.history is not None and len(each.history.step)]
    last = [name for name in mapped if name not in stored]
    texts = ((WITH_HISTORY, stored), (WITHOUT_HISTORY, last))
    parts = [text.format(", ".join(names)) for text, names in texts if names]
    thick = "thick lines are innovations, from the mapped landmark to the observed position"
    return f"{'; '.join([*parts, thick])}."
