"""Studies over the values of one scenario key, next to one optimum."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import informed
from slamgauge.compare.scoring.comparison import YARDSTICKS
from slamgauge.compare.scoring.text_table import aligned, interval_cell
from slamgauge.compare.storage.files import explained, write_json
from slamgauge.compare.studies.store import Runs, digest
from slamgauge.compare.studies.study import load_runs, run_study, write_study
from slamgauge.compare.studies.summary import Failure, Summary, failure_lines, summarise

from slamgauge.errors import UserError


@dataclass(frozen=True)
class Sweep:
    """The summary of a study at each value of `key`; the optima's entries are among its estimators."""

    scenario: str
    key: str
    runs: int
    seed: int
    values: tuple[str, ...]
    summaries: tuple[Summary, ...]

    def to_json(self) -> dict[str, Any]:
        """The content of sweep.json."""
        points = zip(self.values, self.summaries, strict=True)
        return {
            "scenario": self.scenario,
            "key": self.key,
            "runs": self.runs,
            "seed": self.seed,
            "points": [{"value": value, "summary": summary.to_json()} for value, summary in points],
        }


def split_sweep(text: str) -> tuple[str, tuple[str, ...]]:
    """Key and values of `key=v1,v2,...`.

    Raises:
        UserError: it is none, a value stands there twice, or is no plain number or word.
    """
    key, _, rest = text.partition("=")
    values = tuple(value.strip() for value in rest.split(",") if value.strip())
    if not key.strip() or not values:
        raise UserError(f"sweep {text!r}: write key=v1,v2,... , for example association.gate=1,9,100")
    if any(sign in rest for sign in "[]{}/\\"):
        raise UserError(f"sweep {text!r}: lists, tables and paths cannot be swept; write a scenario file for each")
    if len(set(values)) < len(values):
        raise UserError(f"sweep {text!r}: a value stands there twice; name each once")
    return key.strip(), values


def run_sweep(
    name_or_path: str,
    overrides: Sequence[str],
    sweep: str,
    runs: int,
    seed: int,
    estimators: Sequence[str],
    out: Path,
    executor: Executor,
) -> Sweep:
    """A study at every value, stored in folders `key=value` of `out`; what is stored already is not run again.

    The optima are told true noise and associations, which most keys do not touch. They are run once for all
    values at which they see the same.

    Raises:
        UserError: as `load_scenario` and `run_study`.
    """
    key, values = split_sweep(sweep)
    scenarios = [load_scenario(name_or_path, [*overrides, f"{key}={value}"]) for value in values]
    optima = [name for name in estimators if name in YARDSTICKS]
    others = [name for name in estimators if name not in optima]
    for value, scenario in zip(values, scenarios, strict=True):
        first = scenarios.index(scenario)
        if values[first] != value:
            raise UserError(f"sweep {sweep!r}: {values[first]} and {value} are the same value; name each once")
    if not others:
        raise UserError("estimators: a sweep needs one beside the optima; add a filter, for example ekf")
    summaries: list[Summary] = []
    for value, scenario in zip(values, scenarios, strict=True):
        folder, failures, loaded = out / f"{key}={value}", tuple[Failure, ...](), dict[str, Runs]()
        told = informed(scenario)
        beside = out / "optimum" / digest(told, seed)[:12]
        for part, names, where in ((scenario, others, folder), (told, optima, beside)):
            if names:
                failures += run_study(part, runs, seed, names, where, executor).failures
                loaded |= load_runs(part, runs, seed, names, where)
        summary = Summary(scenario.name, runs, seed, digest(scenario, seed), failures, summarise(loaded))
        write_study(folder, summary, loaded, scenario.trajectory.step)
        summaries.append(summary)
    return Sweep(scenarios[0].name, key, runs, seed, values, tuple(summaries))


def write_sweep(out: Path, sweep: Sweep) -> None:
    """Write sweep.json and the figure into `out`."""
    from slamgauge.compare.figures.sweep_figure import save_sweep_figure  # matplotlib only where pictures are made

    with explained(out, "written"):
        save_sweep_figure(out, sweep)
    write_json(out / "sweep.json", sweep.to_json())


_COLUMNS = (
    ("ATE [m]", "ate_m", "{:.3f}"),
    ("x causal", "ratio_to_causal", "{:.3f}"),
    ("NEES/3", "nees_pose_per_dof", "{:.2f}"),
    ("sigma [m]", "position_sigma_m", "{:.3f}"),
    ("mapped", "landmarks_mapped", "{:.1f}"),
    ("wrong", "wrong_associations", "{:.1f}"),
)


def sweep_table(sweep: Sweep) -> str:
    """A line for each value and estimator: means, with the half width of the 95 % interval."""
    rows = [[sweep.key, "estimator", *(title for title, _, _ in _COLUMNS)]]
    for value, summary in zip(sweep.values, sweep.summaries, strict=True):
        for name, entry in summary.estimators.items():
            rows.append([value, name, *(interval_cell(getattr(entry, key), form) for _, key, form in _COLUMNS)])
    failed = [
        f"{sweep.key}={value}, {line}"
        for value, summary in zip(sweep.values, sweep.summaries, strict=True)
        for line in failure_lines(summary)
    ]
    return "\n".join([*aligned(rows, words=2), *failed])
