"""Studies over the values of one scenario key, next to one optimum."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from compare.comparison import OPTIMUM
from compare.files import explained, write_json
from compare.scenario import load_scenario
from compare.simulation import informed
from compare.study import load_runs, run_study, write_study
from compare.study_store import Runs
from compare.study_summary import Summary, summarise
from compare.text_table import aligned, interval_cell


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
        ValueError: it is none, or a value stands there twice.
    """
    key, _, rest = text.partition("=")
    values = tuple(value.strip() for value in rest.split(",") if value.strip())
    if not key.strip() or not values:
        raise ValueError(f"sweep {text!r}: write key=v1,v2,... , for example association.gate=1,9,100")
    if len(set(values)) < len(values):
        raise ValueError(f"sweep {text!r}: a value stands there twice; name each once")
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
        ValueError: as `load_scenario` and `run_study`.
    """
    key, values = split_sweep(sweep)
    scenarios = [load_scenario(name_or_path, [*overrides, f"{key}={value}"]) for value in values]
    optima = [name for name in estimators if name in OPTIMUM.values()]
    others = [name for name in estimators if name not in optima]
    if not others:
        raise ValueError("estimators: a sweep needs one beside the optima; add a filter, for example ekf")
    known: dict[str, dict[str, Runs]] = {}
    summaries: list[Summary] = []
    for value, scenario in zip(values, scenarios, strict=True):
        told, folder = informed(scenario), out / f"{key}={value}"
        same = told.model_dump_json()
        if optima and same not in known:
            beside = out / "optimum" / f"{key}={value}"
            run_study(told, runs, seed, optima, beside, executor)
            known[same] = load_runs(told, runs, seed, optima, beside)
        summary = run_study(scenario, runs, seed, others, folder, executor)
        loaded = load_runs(scenario, runs, seed, others, folder) | known.get(same, {})
        summary = Summary(summary.scenario, runs, seed, summary.digest, summary.failures, summarise(loaded))
        write_study(folder, summary, loaded, scenario.trajectory.step)
        summaries.append(summary)
    return Sweep(scenarios[0].name, key, runs, seed, values, tuple(summaries))


def write_sweep(out: Path, sweep: Sweep) -> None:
    """Write sweep.json and the figure into `out`."""
    from compare.sweep_figure import save_sweep_figure  # matplotlib only where pictures are made

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
    return "\n".join(aligned(rows, words=2))
