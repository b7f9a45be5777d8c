"""The page of a run: what it tells, its figures, and its replay."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from slamgauge.compare.estimators.registry import OPTIMA, REGISTRY
from slamgauge.compare.figures.plot_style import DEAD_RECKONING
from slamgauge.compare.report.glossary import ESTIMATOR, KIND, TERMS, figure_heads, glossary
from slamgauge.compare.report.page import render
from slamgauge.compare.report.page_elements import Cell, Head, Table, looks, origin, pictures, sized
from slamgauge.compare.report.replay_data import replay_data
from slamgauge.compare.scoring.catalogue import RELATIVE, columns
from slamgauge.compare.scoring.comparison import Comparison, optimum_notes
from slamgauge.compare.scoring.optimum_figures import is_in_doubt, is_misfit
from slamgauge.compare.scoring.optimum_notes import MARK
from slamgauge.compare.scoring.text_table import cell
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import METRICS, REPORT
from slamgauge.compare.storage.results_folder import Results, load_results
from slamgauge.estimate import Kind

LARGEST = 2_950_000  # bytes of a page: 3 MB, with room for what a browser may add when it saves it
MOST_CLOSURES = 500  # rows of that table
PICTURES = {
    "figure.png": (
        "Map of the run with paths, landmarks and 3-sigma ellipses, beside the errors in x, y and heading against time",
        "The map, and the errors within their 3-sigma bounds.",
    ),
    "rays.png": (
        "Moments of a bearing-only map: rays begin, lose members and become landmarks",
        "How rays begin, lose members and become landmarks.",
    ),
}
WITH_HISTORY = "maps of {} stand as they stood at that moment"
WITHOUT_HISTORY = "those of {}, which keep no history, as they end (faint)"


def run_page(folder: Path) -> dict[str, str]:
    """The page of what `run` or `evaluate --out` has written into a folder.

    Raises:
        UserError: there are no results in it, or they do not belong together.
    """
    results, path = load_results(folder), folder / METRICS
    metrics = read_json(path, "run")
    others = len(results.estimates) > 1
    shown = looks(results.estimates, hidden=(DEAD_RECKONING,) if others else ())
    comparison = Comparison(results.truth, results.recording, results.estimates, {}, optima_of(results))
    scores = score_table(metrics, doubtful_kinds(comparison))
    drift, closures = drift_table(metrics), closure_table(metrics)

    def page(data: dict[str, Any]) -> str:
        return render(
            "run.html",
            kind="a run",
            title=results.title,
            lead=lead(metrics),
            notes=[*optimum_notes(comparison), *metrics.get("notes", ()), *failures(metrics)],
            table=scores,
            drift=drift,
            closures=closures,
            looks=shown,
            legend=legend(results),
            pictures=pictures(folder, PICTURES),
            glossary=glossary(TERMS["run"], (scores, closures, drift)),
            origin=origin(
                path, metrics, [("Steps", str(results.recording.steps)), ("Sensor", results.recording.sensor)]
            ),
            data=data,
        )

    room = LARGEST - len(page({}).encode())
    return {REPORT: page({"run": replay_data(results, shown, room)})}


def optima_of(results: Results) -> dict[Kind, str]:
    """The optimum of each kind that is among the estimates."""
    return {each.kind: name for name, each in results.estimates.items() if OPTIMA.get(each.kind) == name}


def doubtful_kinds(comparison: Comparison) -> set[str]:
    """Kinds of estimates whose optimum is not what it is taken for."""
    optima = {kind: comparison.estimates[name] for kind, name in comparison.optima.items()}
    return {kind for kind, each in optima.items() if is_in_doubt(each.optimum_check) or is_misfit(each)}


def lead(metrics: dict[str, Any]) -> list[tuple[str, str]]:
    """What the run says of each estimator: its error, that error over the optimum's, and the verdict."""
    return [(name, said) for name, entry in metrics["estimators"].items() if (said := _sentence(name, entry))]


def _sentence(name: str, entry: dict[str, Any]) -> str:
    error, ratio = entry.get("ate_m"), entry.get("ratio_to_optimum")
    parts: list[str] = []
    if error is not None:
        parts.append(f"RMS position error {cell(error, '{:.3f}')} m")
    if name in OPTIMA.values():
        parts.append(f"the {REGISTRY[name].title}, which {entry['kind']} estimates are held against")
    elif ratio is not None:
        optimum = REGISTRY[OPTIMA[entry["kind"]]].title
        parts.append(f"{cell(ratio, '{:.2f}')} times the {optimum}'s")
    if entry.get("verdict"):
        parts.append(entry["verdict"])
    return "; ".join(parts)


def failures(metrics: dict[str, Any]) -> list[str]:
    """Who has no estimate, and why."""
    return [f"{each['estimator']} failed: {each['error']}" for each in metrics.get("failures", ())]


def score_table(metrics: dict[str, Any], doubtful: set[str]) -> Table:
    """The scores, filtered estimates before smoothed ones, as the terminal has them."""
    found = columns("run")
    rows: list[list[Cell]] = []
    for name, entry in sorted(metrics["estimators"].items(), key=lambda item: item[1]["kind"]):
        row = [Cell(name), Cell(entry["kind"])]
        for _, key, form in found:
            value = entry.get(key)
            mark = MARK if value is not None and key in RELATIVE and entry["kind"] in doubtful else ""
            row.append(Cell(cell(value, form) + mark, sized(value)))
        rows.append(row)
    heads = [ESTIMATOR, KIND, *figure_heads("run")]
    return Table("scores", "Figures of the whole run; a click on a head sorts", heads, rows)


def drift_table(metrics: dict[str, Any]) -> Table:
    """Errors of the motion over pieces of the path, by their length."""
    rows = [
        [Cell(name), Cell(f"{each['distance_m']:g}", each["distance_m"])]
        + [
            Cell(cell(each[key], form), each[key])
            for key, form in (("translation_m", "{:.3f}"), ("heading_rad", "{:.4f}"))
        ]
        + [Cell(str(each["pieces"]), each["pieces"])]
        for name, entry in metrics["estimators"].items()
        for each in entry.get("rpe_by_distance") or ()
    ]
    heads = [
        ESTIMATOR,
        Head("over [m]", "length of the pieces along the true path"),
        Head("error [m]", "of the motion over such a piece, seen from where it begins"),
        Head("of the turn [rad]", "error of the turn over such a piece"),
        Head("pieces", "how many there are"),
    ]
    return Table(
        "drift", "Relative pose errors: root mean squares over all pieces of the true path of a length", heads, rows
    )


def closure_table(metrics: dict[str, Any]) -> Table:
    """Errors and sigmas on both sides of every loop closure."""
    keys = ("error_before_m", "error_after_m", "sigma_before_m", "sigma_after_m")
    heads = [
        ESTIMATOR,
        Head("step", "of the loop closure: a landmark of long ago is seen again"),
        Head("error before [m]", "position error at the step before"),
        Head("error after [m]", "at the step itself"),
        Head("sigma before [m]", "position sigma that the estimate claims at the step before"),
        Head("sigma after [m]", "at the step itself"),
    ]
    entries = metrics["estimators"].items()
    closures = [(name, each) for name, entry in entries for each in entry.get("loop_closure") or ()]
    every = max(-(-len(closures) // MOST_CLOSURES), 1)
    rows = [
        [Cell(name), Cell(str(closure["step"]), closure["step"])]
        + [Cell(cell(closure[key], "{:.3f}"), sized(closure[key])) for key in keys]
        for name, closure in closures[::every]
    ]
    which = "each loop closure" if every == 1 else f"1 in {every} loop closures"
    return Table("closures", f"Position error and its sigma before and after {which}", heads, rows)


def legend(results: Results) -> str:
    """What the maps of the replay are."""
    mapped = {name: each for name, each in results.estimates.items() if len(each.landmark_ids)}
    kept = [name for name, each in mapped.items() if each.history is not None and len(each.history.step)]
    last = [name for name in mapped if name not in kept]
    parts = [text.format(", ".join(names)) for text, names in ((WITH_HISTORY, kept), (WITHOUT_HISTORY, last)) if names]
    thick = "thick strokes are innovations, from where the map had a landmark to where the sight puts it"
    return f"{'; '.join([*parts, thick])}."
