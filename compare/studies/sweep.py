"""Sweeps: a study at each value of one scenario key."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from slamgauge.compare.estimators.registry import BOUNDS, CAUSAL, HINDSIGHT
from slamgauge.compare.estimators.requests import Chosen, ask
from slamgauge.compare.estimators.running import require_room_for_runs
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import informed
from slamgauge.compare.scoring.catalogue import figure_cells, heads
from slamgauge.compare.scoring.optimum_notes import at_places, misfits, placed
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.scoring.table import ESTIMATOR, Cell, Head, Page, Table
from slamgauge.compare.storage.files import of_this_version, read_json
from slamgauge.compare.storage.result_files import OPTIMA, SWEEP, origin
from slamgauge.compare.storage.staged_folder import begin_folder, require_ours
from slamgauge.compare.studies.stored_study import load_study, optima_beside
from slamgauge.compare.studies.study import run_beside_optima
from slamgauge.compare.studies.study_run import require_numbers
from slamgauge.compare.studies.summary import (
    Summary,
    failure_lines,
    is_bounded,
    is_marked_against,
    misfit_optima,
    share_in_doubt,
)
from slamgauge.errors import UserError

Finished = Callable[[Path, Summary, dict[str, Runs], float], None]


@dataclass(frozen=True)
class Sweep:
    """Summaries of the studies at each value of `key`, optima included."""

    scenario: str
    key: str
    runs: int
    seed: int
    values: tuple[str, ...]
    summaries: tuple[Summary, ...]

    def of(self, names: Sequence[str]) -> Sweep:
        """Return the sweep of some of the estimators."""
        summaries = (
            replace(each, estimators={name: each.estimators[name] for name in names}) for each in self.summaries
        )
        return replace(self, summaries=tuple(summaries))

    def by_value(self) -> Iterable[tuple[str, Summary]]:
        """Return each value with its summary."""
        return zip(self.values, self.summaries, strict=True)

    def by_place(self) -> dict[str, Summary]:
        """Return the summaries by `key=value`."""
        return {f"{self.key}={value}": summary for value, summary in self.by_value()}

    def to_json(self) -> dict[str, Any]:
        """Return the content of sweep.json."""
        points: list[dict[str, Any]] = []
        for value, summary in self.by_value():
            doubtful = [name for name in (CAUSAL, HINDSIGHT) if is_marked_against(summary, name)]
            points.append({"value": value, "in_doubt": doubtful, "summary": summary.to_json()})
        given = {key: getattr(self, key) for key in ("scenario", "key", "runs", "seed")}
        found = {"points": points, "faults": faults(self), "notes": notes(self)}
        return {**origin(self.summaries[0].scenario_text), **given, **found}


def read_sweep(folder: Path) -> Sweep:
    """Read the sweep that `slamgauge study --sweep` has written into a folder, from the studies of its values.

    Raises:
        UserError: the folder has no sweep, or lacks a study of it.
    """
    path = folder / SWEEP
    content = read_json(path)
    with of_this_version(path):
        key, values = content["key"], tuple(str(point["value"]) for point in content["points"])
        summaries = tuple(load_study(folder / f"{key}={value}").summary for value in values)
        return Sweep(content["scenario"], key, content["runs"], content["seed"], values, summaries)


def split_sweep(text: str) -> tuple[str, tuple[str, ...]]:
    """Return key and values of `key=v1,v2,...`.

    Raises:
        UserError: the text has another form, a value appears twice, or is not a plain number or word.
    """
    key, _, rest = text.partition("=")
    values = tuple(value.strip() for value in rest.split(",") if value.strip())
    if not key.strip() or not values:
        raise UserError(f"sweep {text!r}: write key=v1,v2,... , for example association.gate=1,9,100")
    if any(sign in rest for sign in "[]{}/\\"):
        raise UserError(f"sweep {text!r}: lists, tables and paths cannot be swept; write a scenario file for each")
    if len(set(values)) < len(values):
        raise UserError(f"sweep {text!r}: a value is repeated; name each once")
    return key.strip(), values


def run_sweep(
    name_or_path: str,
    overrides: Sequence[str],
    sweep: str,
    runs: int,
    seed: int,
    estimators: Chosen,
    out: str | Path,
    executor: Executor,
    finished: Finished | None = None,
) -> Sweep:
    """Run a study at every value `key=v1,v2,...`, stored in folders `key=value` of `out`; stored runs are not repeated.

    The optima run once for all values with the same measurements. The parameters are those of `load_scenario` and
    `run_study`; `finished` is called after the study of each value with its folder, summary, runs and time step [s].

    Raises:
        UserError: as `load_scenario` and `run_study`; two values make the same scenario, such as 1 and 1.0; before
            any run if a foreign file would be replaced.
    """
    out = Path(out)
    key, values = split_sweep(sweep)
    folders = [f"{key}={value}" for value in values]
    scenarios = [load_scenario(name_or_path, [*overrides, folder]) for folder in folders]
    for value, scenario in zip(values, scenarios, strict=True):
        first = values[scenarios.index(scenario)]
        if first != value:
            raise UserError(f"sweep {sweep!r}: {first} and {value} are the same value; name each once")
    asked = ask(estimators)
    if all(each.is_told for each in asked):
        raise UserError("estimators: a sweep needs an estimator beside the optima; add a filter, for example ekf")
    has_optima = any(each.is_told for each in asked)
    besides = [optima_beside(out / OPTIMA, informed(scenario), seed) for scenario in scenarios]
    require_numbers(runs, seed)
    for scenario in scenarios:
        require_room_for_runs(runs, scenario, len(asked))
    require_ours(*map(out.joinpath, folders), *(besides if has_optima else []))
    begin_folder(out)
    summaries: list[Summary] = []
    for scenario, folder, beside in zip(scenarios, map(out.joinpath, folders), besides, strict=True):
        summary = run_beside_optima(scenario, asked, runs, seed, (folder, beside), executor)
        if finished is not None:
            finished(folder, summary, dict(summary.loaded), scenario.trajectory.step)
        summaries.append(replace(summary, loaded={}))  # the runs of all values may not fit into memory
    return Sweep(scenarios[0].name, key, runs, seed, values, tuple(summaries))


def sweep_table(sweep: Sweep) -> Page:
    """Return a table with a row for each value and estimator: means with 95 % intervals; below it notes and faults."""
    below = [*notes(sweep), *(f"{name}: {text}" for name, text in faults(sweep).items())]
    for place, summary in sweep.by_place().items():
        below += [f"{place}, {line}" for line in (*failure_lines(summary), *summary.comparisons)]
    return Page((value_table(sweep), *below))


def value_table(sweep: Sweep, links: Mapping[str, str] = MappingProxyType({})) -> Table:
    """Return the means of every value and estimator; `links` are the pages of the studies by value."""
    found = heads("sweep", bounded=is_bounded(sweep.summaries[0].estimators))
    any_doubt = any(is_marked_against(summary, CAUSAL) for summary in sweep.summaries)
    rows = [
        [
            *(Cell(value, link=links.get(value, "")), Cell(name)),
            *figure_cells(entry, found, is_marked_against(summary, CAUSAL) if any_doubt else None),
        ]
        for value, summary in sweep.by_value()
        for name, entry in summary.estimators.items()
    ]
    swept = Head(sweep.key, help="value of this key of the scenario", words=True)
    return Table(
        [swept, ESTIMATOR, *found], rows, "Means over runs, with half the width of their 95 % intervals", "sweep"
    )


def notes(sweep: Sweep) -> list[str]:
    """Return notes on the optima."""
    fits = {place: misfits(misfit_optima(summary)) for place, summary in sweep.by_place().items()}
    return [*at_places(CAUSAL, shares_in_doubt(sweep)), *placed(fits)]


def faults(sweep: Sweep) -> dict[str, str]:
    """Return what is wrong with each estimator that has runs, and at which values."""
    lines: dict[str, str] = {}
    for name in dict.fromkeys(name for summary in sweep.summaries for name in summary.estimators if name not in BOUNDS):
        places: dict[str, list[str]] = {}
        for value, summary in sweep.by_value():
            for fault in summary.estimators[name]["faults"]:
                places.setdefault(fault, []).append(value)
        found = [
            f"{fault} at {'every value' if len(at) == len(sweep.values) else f'{sweep.key}=' + ', '.join(at)}"
            for fault, at in places.items()
        ]
        if any(summary.estimators[name]["runs"] for summary in sweep.summaries):
            lines[name] = "; ".join(found) or f"nothing wrong is shown by {sweep.runs} runs"
    return lines


def shares_in_doubt(sweep: Sweep) -> dict[str, float]:
    """Return the share of the runs in which the causal optimum is in doubt, by `key=value`."""
    return {place: share_in_doubt(summary) for place, summary in sweep.by_place().items()}
