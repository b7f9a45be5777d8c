"""The summary of a study: means over runs with 95 % intervals, paired ratios, consistency at every step."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any, NamedTuple

from slamgauge.compare.estimators.registry import BOUND_OF, BOUNDS, CAUSAL, HINDSIGHT, REGISTRY, is_ours
from slamgauge.compare.scoring.aggregation import BAND_LEVEL, late_means
from slamgauge.compare.scoring.catalogue import FULL_NAMES, RELATIVE, SUMMED_UP, columns, empty_columns
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.metric import Table
from slamgauge.compare.scoring.nan_stats import number
from slamgauge.compare.scoring.optimum_figures import is_misfit_in_runs
from slamgauge.compare.scoring.optimum_notes import MARK, beats_the_optimum, doubt_in_runs, mean_fit, misfits
from slamgauge.compare.scoring.ray_figures import RayFigures, describe
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.scoring.text_page import Grid, Page
from slamgauge.compare.scoring.text_table import cell, interval_cell, marked
from slamgauge.compare.scoring.verdicts import verdict_lines
from slamgauge.compare.storage.provenance import origin
from slamgauge.compare.studies.paired_comparisons import Against, against_parts
from slamgauge.display import data_frame


@dataclass(frozen=True, kw_only=True)
class EstimatorSummary:
    """Figures of one estimator over the runs of a study; a figure that does not apply is None.

    `scoring.catalogue` describes each figure and its aggregation over runs. `runs` is the number of runs without
    failure; `kind` is None if all failed; `others` has the figures without a field here.
    """

    kind: str | None
    runs: int
    ate_m: Interval | None
    position_rmse_m: Interval | None
    heading_rmse_rad: Interval | None
    final_position_error_m: Interval | None
    nis_per_dof: Interval | None
    landmark_rmse_m: Interval | None
    landmark_nees_per_dof: Interval | None
    nees_pose_per_dof: Interval | None
    nees_position_per_dof: Interval | None
    nees_heading: Interval | None
    ratio_to_optimum: Interval | None
    ratio_to_causal: Interval | None
    ratio_to_bound: Interval | None
    ratio_to_hindsight: Interval | None
    position_sigma_m: Interval | None
    wrong_associations: Interval | None
    landmarks_mapped: Interval | None
    landmarks_missed: Interval | None
    landmarks_spurious: Interval | None
    nees_share_inside_band: float | None
    sigma_ratio_to_optimum_final: tuple[float | None, ...] | None
    rays: RayFigures | None
    seconds_total: float | None
    optimum_check_share: float | None = None
    log_score_to_causal: Interval | None = None
    verdict: str | None = None
    faults: tuple[str, ...] = ()
    others: dict[str, Interval | None] = field(default_factory=dict)

    def figure(self, key: str) -> Any:
        """Return a figure of the catalogue by its key."""
        return self.others[key] if key in self.others else getattr(self, key)

    def to_json(self) -> dict[str, Any]:
        """Return the estimator's entry in summary.json; without `rays` if the estimator has none."""
        entry: dict[str, Any] = {key: getattr(self, key) for key in FIELDS} | self.others
        entry = {key: value._asdict() if isinstance(value, Interval) else value for key, value in entry.items()}
        if self.nees_share_inside_band is not None:
            entry["nees_share_inside_band"] = {"level": BAND_LEVEL, "share": self.nees_share_inside_band}
        if self.sigma_ratio_to_optimum_final is not None:
            entry["sigma_ratio_to_optimum_final"] = list(self.sigma_ratio_to_optimum_final)
        if self.rays is None:
            del entry["rays"]
        else:
            entry["rays"] = self.rays._asdict()
        entry["seconds_total"] = {"mean": self.seconds_total}
        return entry


def read_entry(entry: Mapping[str, Any]) -> EstimatorSummary:
    """Read an estimator's summary from its entry in summary.json; `TypeError` or `KeyError` if it is not valid."""
    values: dict[str, Any] = {key: Interval(**value) if _is_interval(value) else value for key, value in entry.items()}
    band, ratios, rays = (entry.get(key) for key in ("nees_share_inside_band", "sigma_ratio_to_optimum_final", "rays"))
    values |= {
        "nees_share_inside_band": None if band is None else band["share"],
        "sigma_ratio_to_optimum_final": None if ratios is None else tuple(ratios),
        "rays": None if rays is None else RayFigures(**rays),
        "seconds_total": entry["seconds_total"]["mean"],
        "faults": tuple(entry["faults"]),
    }
    others = {key: values.pop(key) for key in [*values] if key not in FIELDS}
    return EstimatorSummary(**values, others=others)


def _is_interval(value: object) -> bool:
    return isinstance(value, dict) and set(value) == {*Interval._fields}


FIELDS = tuple(each.name for each in fields(EstimatorSummary) if each.name != "others")


@dataclass(frozen=True)
class Failure:
    """A run in which an estimator failed."""

    run: int
    estimator: str
    error: str


class RunFigures(NamedTuple):
    """Figures of one estimator in each run without failure, which later studies are compared with.

    Attributes:
        run: (R,) numbers of the runs, increasing.
        ate_m: (R,) ATE [m]; None where undefined.
        nees_pose_per_dof: (R,) mean pose NEES over 3 from the 11th step on; None where undefined.
    """

    run: list[int]
    ate_m: list[float | None]
    nees_pose_per_dof: list[float | None]


def run_figures(runs: Runs) -> RunFigures:
    """Return the figures of each run of an estimator."""
    ate, nees = runs.figures["ate_m"], late_means(runs.series["nees_pose"]) / 3
    return RunFigures(runs.run.tolist(), *([number(each) for each in column] for column in (ate, nees)))


@dataclass(frozen=True)
class Summary:
    """Summary of a study: summary.json as an object.

    `scenario` is a name, `runs` the number of runs, `seed` the root seed, `digest` that of the measurements, `failures`
    the failed runs of estimators, `estimators` the figures of each estimator by name, `per_run` those of each run,
    `against` the requested paired comparisons, `scenario_text` the scenario as a TOML file, `comparisons` pairs of a
    user estimator and a sentence, which are only printed.
    """

    scenario: str
    runs: int
    seed: int
    digest: str
    failures: tuple[Failure, ...]
    estimators: dict[str, EstimatorSummary]
    against: Against = field(default_factory=dict)
    scenario_text: str | None = None
    comparisons: tuple[tuple[str, str], ...] = ()
    per_run: Mapping[str, RunFigures] = field(default_factory=dict[str, RunFigures])

    def __repr__(self) -> str:
        return f"Summary({self.scenario}, {self.runs} runs: {', '.join(self.estimators)})"

    def _repr_html_(self) -> str:
        return summary_table(self).html()

    def to_frame(self) -> Any:
        """Return a `pandas.DataFrame`: a row for each estimator, columns KEY (mean over runs), KEY_low and KEY_high."""
        entries = {name: entry.to_json() for name, entry in self.estimators.items()}
        keys = dict.fromkeys(key for each in entries.values() for key, value in each.items() if _is_interval(value))
        columns: dict[str, list[float | None]] = {}
        for key in keys:
            for end, name in (("mean", key), ("low", f"{key}_low"), ("high", f"{key}_high")):
                columns[name] = [(entry[key] or {}).get(end) for entry in entries.values()]
        return data_frame(columns, [*entries])

    def to_json(self) -> dict[str, Any]:
        """Return the content of summary.json."""
        return {
            **origin(self.scenario_text),
            "scenario": self.scenario,
            "runs": self.runs,
            "seed": self.seed,
            "digest": self.digest,
            "failures": [asdict(failure) for failure in self.failures],
            "estimators": {name: entry.to_json() for name, entry in self.estimators.items()},
            "per_run": {name: figures._asdict() for name, figures in self.per_run.items()},
            "against": {
                name: {
                    label: {key: each.to_json() for key, each in figures.items()} for label, figures in others.items()
                }
                for name, others in self.against.items()
            },
            **bound_entry(self.estimators),
        }


def bound_entry(estimators: Mapping[str, EstimatorSummary]) -> dict[str, Any]:
    """Return the entry `bound` of summary.json; empty without bounds."""
    if not is_bounded(estimators):
        return {}
    bounds = {kind: estimators[name].position_rmse_m if name in estimators else None for kind, name in BOUND_OF.items()}
    rmse = {kind: None if each is None else each.mean for kind, each in bounds.items()}
    return {"bound": {"causal_position_rmse_m": rmse["filtered"], "hindsight_position_rmse_m": rmse["smoothed"]}}


def is_bounded(estimators: Collection[str]) -> bool:
    """Whether a bound is among the estimators of a study."""
    return not BOUNDS.keys().isdisjoint(estimators)


def summarise(runs: Mapping[str, Runs]) -> dict[str, EstimatorSummary]:
    """Return the summaries of estimators that ran on the same recordings."""
    summaries: dict[str, EstimatorSummary] = {}
    for name, each in runs.items():
        figures = {key: over_runs(each, runs) for key, over_runs in SUMMED_UP.items()}
        others = {key: figures.pop(key) for key in [*figures] if key not in FIELDS}
        summaries[name] = EstimatorSummary(kind=each.kind or None, runs=len(each.run), **figures, others=others)
    return summaries


def summary_table(summary: Summary) -> Page:
    """Return the table of a study: means with 95 % intervals; below it notes, verdicts, failures and comparisons."""
    found = columns("study", bounded=is_bounded(summary.estimators))
    is_marked = is_doubtful(summary)
    titles = (title for title, _, _ in found)
    rows = [["estimator", "runs", *titles, f"NEES in {BAND_LEVEL:.1%} band", "final sigma / optimum"]]
    for name, entry in summary.estimators.items():
        cells = [name, str(entry.runs), *figure_cells(summary, entry, found, room_for_marks=is_marked)]
        share, ratios = entry.nees_share_inside_band, entry.sigma_ratio_to_optimum_final
        cells.append(cell(share, "{:.1%}"))
        cells.append(" ".join(cell(ratio, "{:.3f}") for ratio in ratios or (None,)))
        if is_marked:
            optimum = CAUSAL if entry.kind == "filtered" else HINDSIGHT
            cells[-1] = marked(cells[-1], MARK, is_marked=is_marked_against(summary, optimum))
        rows.append(cells)
    rays = [f"{name}: a run's {describe(each.rays)}" for name, each in summary.estimators.items() if each.rays]
    below = [
        *optimum_lines(summary),
        *empty_column_lines([summary], "study"),
        *rays,
        *verdict_lines({name: each.verdict for name, each in summary.estimators.items()}),
        *too_good_lines(summary),
        *failure_lines(summary),
    ]
    below += [*against_parts(summary.against), *(text for _, text in summary.comparisons)]
    return Page((Grid(rows, names=FULL_NAMES), *below))


def share_in_doubt(summary: Summary) -> float:
    """Return the share of the runs in which the causal optimum is in doubt."""
    causal = summary.estimators.get(CAUSAL)
    return 0.0 if causal is None else causal.optimum_check_share or 0.0


def misfit_optima(summary: Summary) -> list[str]:
    """Return the optima whose residuals do not fit the stated noise."""
    fits = {name: summary.estimators[name].others.get("chi_square_per_dof") for name in _optima(summary)}
    return [name for name, fit in fits.items() if is_misfit_in_runs(fit)]


def is_marked_against(summary: Summary, optimum: str) -> bool:
    """Whether figures relative to an optimum of a study are marked."""
    return optimum in misfit_optima(summary) or (optimum == CAUSAL and share_in_doubt(summary) > 0)


def is_doubtful(summary: Summary) -> bool:
    """Whether figures relative to any optimum of a study are marked."""
    return any(is_marked_against(summary, name) for name in _optima(summary))


def _optima(summary: Summary) -> list[str]:
    return [name for name in (HINDSIGHT, CAUSAL) if name in summary.estimators]


def figure_cells(
    summary: Summary, entry: EstimatorSummary, found: list[tuple[str, str, str]], *, room_for_marks: bool
) -> list[str]:
    """Return an estimator's cells in a table; figures relative to an optimum in doubt are marked."""
    optimum = {**dict.fromkeys(RELATIVE, CAUSAL), "ratio_to_hindsight": HINDSIGHT} if room_for_marks else {}
    if not is_marked_against(summary, HINDSIGHT):
        optimum.pop("ratio_to_hindsight", None)  # this column needs no room for marks
    texts = {key: interval_cell(entry.figure(key), form) for _, key, form in found}
    return [
        marked(text, MARK, is_marked=is_marked_against(summary, optimum[key])) if key in optimum else text
        for key, text in texts.items()
    ]


def optimum_lines(summary: Summary) -> list[str]:
    """Return lines on the optima: the fit of the model, and whether the causal optimum is in doubt."""
    fits = [
        mean_fit(REGISTRY[name].title, summary.estimators[name].others.get("chi_square_per_dof"))
        for name in _optima(summary)[:1]
    ]
    lines = [*fits, misfits(misfit_optima(summary)), doubt_in_runs(CAUSAL, share_in_doubt(summary))]
    return [line for line in lines if line]


def too_good_lines(summary: Summary) -> list[str]:
    """Return a line for each user filter that is significantly better than a causal optimum without doubt."""
    if is_marked_against(summary, CAUSAL):
        return []
    own = {name: each for name, each in summary.estimators.items() if not is_ours(name) and each.kind == "filtered"}
    known = summary.estimators[CAUSAL].runs if CAUSAL in summary.estimators else 0
    found = {name: beats_the_optimum(each.ratio_to_causal, min(each.runs, known)) for name, each in own.items()}
    return [f"{name}: {text}" for name, text in found.items() if text]


def empty_column_lines(summaries: Sequence[Summary], table: Table) -> list[str]:
    """Return a line that names the empty columns of a table of these summaries; no line if none is empty."""
    entries = [entry for summary in summaries for entry in summary.estimators.values()]
    bounded = any(is_bounded(summary.estimators) for summary in summaries)
    return empty_columns(table, lambda key: all(each.figure(key) is None for each in entries), bounded=bounded)


def failure_lines(summary: Summary) -> list[str]:
    """Return a line for each run in which an estimator failed."""
    return [f"run {failure.run}: {failure.estimator} failed: {failure.error}" for failure in summary.failures]
