"""The summary of a study: means over runs with 95 % intervals, paired ratios, and its table with notes."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic_core import to_jsonable_python

from slamgauge.compare.estimators.registry import BOUNDS, CAUSAL, HINDSIGHT, REGISTRY, is_ours
from slamgauge.compare.scoring.catalogue import BY_KEY, figure_cells, heads
from slamgauge.compare.scoring.optimum_notes import beats_the_optimum, doubt_in_runs, is_misfit_in_runs, misfits
from slamgauge.compare.scoring.runs import Runs, rays_text
from slamgauge.compare.scoring.scores import FiguresByKey
from slamgauge.compare.scoring.table import ESTIMATOR, RUNS, Cell, Page, Table, cell
from slamgauge.compare.storage.result_files import origin
from slamgauge.compare.studies.paired_comparisons import Against, RunFigures, against_parts


@dataclass(frozen=True, eq=False)
class EstimatorSummary(FiguresByKey):
    """Figures of one estimator over the runs of a study: its entry in summary.json.

    `kind` (None if all runs failed) and `runs`, the number of runs without failure, are keys, too.
    """


@dataclass(frozen=True, order=True)
class Failure:
    """A run in which an estimator failed."""

    run: int
    estimator: str
    error: str


@dataclass(frozen=True)
class Request:
    """What a command requested, so that single runs can be repeated.

    `scenario` is its name or path, `settings` are the values of --set, `estimators` names separated by commas, `swept`
    is `key=value` of a value of a sweep and empty for other studies.
    """

    scenario: str
    settings: tuple[str, ...]
    estimators: str
    swept: str = ""


@dataclass(frozen=True)
class Summary:
    """Summary of a study: summary.json as an object.

    `scenario` is a name, `runs` the number of runs, `seed` the root seed, `digest` that of the measurements, `failures`
    the failed runs of estimators, `estimators` the figures of each estimator by name, `per_run` those of each run,
    `against` the requested paired comparisons, `scenario_text` the scenario as a TOML file, `comparisons` sentences
    on user estimators, which are only printed, `request` what a command requested, `loaded` the stored runs.
    """

    scenario: str
    runs: int
    seed: int
    digest: str
    failures: tuple[Failure, ...]
    estimators: dict[str, EstimatorSummary]
    against: Against = field(default_factory=dict)
    scenario_text: str | None = None
    comparisons: tuple[str, ...] = ()
    per_run: Mapping[str, RunFigures] = field(default_factory=dict[str, RunFigures])
    request: Request | None = None
    loaded: Mapping[str, Any] = field(default_factory=dict[str, Any], compare=False)  # `Runs`, unknown to pydantic

    def __repr__(self) -> str:
        return f"Summary({self.scenario}, {self.runs} runs: {', '.join(self.estimators)})"

    def _repr_html_(self) -> str:
        return summary_table(self).html()

    def to_json(self) -> dict[str, Any]:
        """Return the content of summary.json."""
        content = {
            **origin(self.scenario_text),
            **{key: getattr(self, key) for key in ("scenario", "runs", "seed", "digest")},
            "estimators": {name: entry.to_json() for name, entry in self.estimators.items()},
            **{key: getattr(self, key) for key in ("failures", "per_run", "against", "request")},
        }
        return to_jsonable_python(content)


def is_bounded(estimators: Collection[str]) -> bool:
    """Whether a bound is among the estimators of a study."""
    return not BOUNDS.keys().isdisjoint(estimators)


def summarise(runs: Mapping[str, Runs]) -> dict[str, EstimatorSummary]:
    """Return the summaries of estimators that ran on the same recordings."""
    summaries: dict[str, EstimatorSummary] = {}
    for name, each in runs.items():
        figures = {key: metric.over_runs(each, runs) for key, metric in BY_KEY.items() if metric.over_runs is not None}
        summaries[name] = EstimatorSummary({"kind": each.kind or None, "runs": len(each.run), **figures})
    return summaries


def summary_table(summary: Summary) -> Page:
    """Return the table of a study: means with 95 % intervals; below it notes, verdicts, failures and comparisons."""
    rays = [f"{name}: a run's {rays_text(each['rays'])}" for name, each in summary.estimators.items() if each["rays"]]
    below = [
        *optimum_lines(summary),
        *rays,
        *(f"{name}: {each['verdict']}" for name, each in summary.estimators.items() if each["verdict"]),
        *too_good_lines(summary),
        *failure_lines(summary),
    ]
    below += [*against_parts(summary.against), *summary.comparisons]
    return Page((estimator_table(summary), *below))


def estimator_table(summary: Summary) -> Table:
    """Return means with 95 % intervals, a row for each estimator."""
    found = heads("study", bounded=is_bounded(summary.estimators))
    is_marked = is_marked_against(summary, CAUSAL) or None
    rows: list[list[Cell | str]] = []
    for name, entry in summary.estimators.items():
        cells = figure_cells(entry, found, is_marked)
        rows.append([name, Cell(str(entry["runs"]), entry["runs"]), *cells])
    caption = "Means over runs with their 95 % intervals; click a column title to sort"
    return Table.of([ESTIMATOR, RUNS, *found], rows, caption, "summary")


def share_in_doubt(summary: Summary) -> float:
    """Return the share of the runs in which the causal optimum is in doubt."""
    causal = summary.estimators.get(CAUSAL)
    return 0.0 if causal is None else causal["optimum_check_share"] or 0.0


def misfit_optima(summary: Summary) -> list[str]:
    """Return the optima whose residuals do not fit the stated noise."""
    fits = {name: summary.estimators[name]["chi_square_per_dof"] for name in _optima(summary)}
    return [name for name, fit in fits.items() if is_misfit_in_runs(fit)]


def is_marked_against(summary: Summary, optimum: str) -> bool:
    """Whether figures relative to an optimum of a study are marked."""
    return optimum in misfit_optima(summary) or (optimum == CAUSAL and share_in_doubt(summary) > 0)


def _optima(summary: Summary) -> list[str]:
    return [name for name in (HINDSIGHT, CAUSAL) if name in summary.estimators]


def optimum_lines(summary: Summary) -> list[str]:
    """Return lines on the optima: the fit of the model, and whether the causal optimum is in doubt."""
    fits = {REGISTRY[name].title: summary.estimators[name]["chi_square_per_dof"] for name in _optima(summary)[:1]}
    shown = {title: cell(fit, "{:.3f}") for title, fit in fits.items() if fit is not None}
    lines = [f"fit of the model: chi2/dof of the {title} {figure}" for title, figure in shown.items()]
    doubts = (misfits(misfit_optima(summary)), doubt_in_runs(CAUSAL, share_in_doubt(summary)))
    return [*lines, *filter(None, doubts)]


def too_good_lines(summary: Summary) -> list[str]:
    """Return a line for each user filter that is significantly better than a causal optimum without doubt."""
    if is_marked_against(summary, CAUSAL):
        return []
    known = summary.estimators[CAUSAL]["runs"] if CAUSAL in summary.estimators else 0
    lines: list[str] = []
    for name, each in summary.estimators.items():
        if not is_ours(name) and each["kind"] == "filtered":
            text = beats_the_optimum(each["ratio_to_causal"], min(each["runs"], known))
            lines += [f"{name}: {text}"] if text else []
    return lines


def failure_lines(summary: Summary) -> list[str]:
    """Return a line for each run in which an estimator failed."""
    return [f"run {failure.run}: {failure.estimator} failed: {failure.error}" for failure in summary.failures]
