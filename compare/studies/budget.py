"""The error budget: a filter's mean squared position error split into rungs, all run on the same measurements.

hindsight optimum -> causal optimum -> with the noise the filter assumes -> with the filter's associations
-> on request a fixed-lag smoother -> the filter. The cost of a rung is the error that it adds. The associations are
those at the end of the run, after deletion and merging.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import repeat
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import TypeAdapter
from pydantic_core import to_jsonable_python

from slamgauge.arrays import Float
from slamgauge.compare.estimators.loading import load
from slamgauge.compare.estimators.registry import CAUSAL, FILTERS, FIXED_LAG, HINDSIGHT
from slamgauge.compare.estimators.requests import Asked, BuiltIn, ask
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.scenarios.scenario import Scenario, as_scenario, scenario_text
from slamgauge.compare.scenarios.schema import Assumed
from slamgauge.compare.scenarios.simulation import simulate_informed
from slamgauge.compare.scoring.catalogue import Measured
from slamgauge.compare.scoring.consistency import pose_errors
from slamgauge.compare.scoring.intervals import Interval, bootstrap_interval, mean_interval
from slamgauge.compare.scoring.optimum_notes import MARK, at_places, is_misfit_in_runs, misfits, share_of_doubt
from slamgauge.compare.scoring.table import Cell, Head, Page, Table, from_to, marked
from slamgauge.compare.storage import progress
from slamgauge.compare.storage.files import of_this_version, read_json
from slamgauge.compare.storage.result_files import BUDGET, origin
from slamgauge.compare.studies.store import digest
from slamgauge.compare.studies.study_run import require_numbers, run_seed
from slamgauge.display import counted
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.memory import require_memory
from slamgauge.recording import Recording
from slamgauge.truth import NOBODY
from slamgauge.validation import as_whole

RUNGS = {
    "hindsight optimum": "unavoidable, even with all measurements",
    "causal optimum": "only past measurements",
    "assumed noise": "wrong assumed noise",
    "own associations": "wrong associations",
    FIXED_LAG: "steps before the lag are not relinearised",
    "linearisation": "linearisation of the filter",
}
HEADS = (
    Head("rung", help="an estimator on the same measurements: one disadvantage more than the rung before", words=True),
    Head("mse [m^2]", help="mean squared position error over runs and steps"),
    Head("adds [m^2]", help="increase over the rung before: the largest possible gain there"),
    Head("95 % interval", help="interval of the increase, bootstrapped over runs"),
    Head("cause", help="the disadvantage that the rung adds", words=True, wraps=True),
)
BYTES = 1000  # memory for the results of a run


@dataclass(frozen=True)
class Rung:
    """One rung: its mean squared position error [m^2], and the error that it adds, with 95 % interval.

    `optimum_check_share` is the share of runs in which its causal optimum is in doubt; None for other rungs. The error
    that it adds is `in_doubt` if this optimum or that before it is, or if the optima do not fit the stated noise.
    """

    name: str
    mse_m2: float
    increment_m2: Interval
    optimum_check_share: float | None
    in_doubt: bool


@dataclass(frozen=True)
class ErrorBudget:
    """Error budget of a filter on a scenario.

    `rungs` split the mean squared error of `filter` over the `runs` of `scenario` into its causes [m²]; `costliest` is
    the rung after the first that adds most. `fit` is the mean chi2/dof of the hindsight optimum, `scenario_text` the
    scenario as a TOML file, `seed` the root seed, `digest` that of both.
    """

    scenario: str
    filter: str
    runs: int
    rungs: tuple[Rung, ...]
    costliest: str
    fit: Interval | None
    scenario_text: str | None = None
    seed: int | None = None
    digest: str | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the content of budget.json."""
        content: dict[str, Any] = to_jsonable_python(self) | origin(self.scenario_text)
        return content | {"chi_square_per_dof": content.pop("fit"), "verdict": verdict(self), "notes": notes(self)}


def read_budget(folder: Path) -> ErrorBudget:
    """Read the budget that `slamgauge budget` has written into a folder.

    Raises:
        UserError: budget.json does not exist or is not valid.
    """
    path = folder / BUDGET
    content = read_json(path)
    with of_this_version(path):
        return TypeAdapter(ErrorBudget).validate_python({**content, "fit": content["chi_square_per_dof"]})


class RungErrors(NamedTuple):
    """One run of a budget: mean squared errors (n,) [m^2] of the rungs, and checks (n,) and `fit` of their optima."""

    errors: Float
    checks: Float
    fit: float  # chi2/dof of the hindsight optimum; NaN if unknown


def error_budget(
    scenario: Scenario | str | Path,
    filter_name: str,
    runs: int,
    seed: int,
    executor: Executor,
    lag: int | None = None,
) -> ErrorBudget:
    """Compute the budget of a built-in or user filter over `runs` runs; their seeds are spawned from `seed`.

    With a `lag` [steps] the fixed-lag smoother is a rung, too. Intervals are bootstrapped over runs.

    Raises:
        UserError: bad names or numbers, or an estimator that failed, with the run.
    """
    scenario = as_scenario(scenario)
    (asked,) = ask([filter_name])
    if lag is not None:
        as_whole("lag", lag, "steps leave no window", 1)
    if isinstance(asked, BuiltIn) and asked.name not in FILTERS:
        raise UserError(
            f"filter: {filter_name!r} is not a filter whose error can be split; use {', '.join(FILTERS)}, or your own"
        )
    require_numbers(runs, seed)
    require_memory(1.0 * BYTES * runs, f"runs: a budget of {runs}", "give fewer")
    seeds = [run_seed(seed, run) for run in range(runs)]
    results = executor.map(rung_errors, repeat(scenario), seeds, repeat(asked), repeat(lag))
    shown = progress.counted(runs, "run", scenario.name, leave=True, items=results)
    errors, checks, fits = zip(*shown, strict=True)
    budget = summarise_budget(scenario.name, asked.label, np.array(errors), np.array(checks), np.array(fits))
    found = {"scenario_text": scenario_text(scenario), "seed": seed, "digest": digest(scenario, seed)}
    return replace(budget, **found)


def summarise_budget(scenario: str, filter_name: str, table: Float, checks: Float, fits: Float) -> ErrorBudget:
    """Compute the budget from mean squared errors (runs, n) [m^2], checks (runs, n) and fits (runs,); n = 5 or 6 rungs.

    Five columns are all rungs without the fixed lag. Unknown checks and fits are NaN.
    """
    names = [name for name in RUNGS if name != FIXED_LAG or table.shape[1] == len(RUNGS)]
    increments = np.diff(table, axis=1, prepend=0.0)
    shares = [share_of_doubt(check) for check in checks.T]
    fit, rungs = mean_interval(fits), list[Rung]()
    before: float | None = None
    for name, errors, added, share in zip(names, table.T, increments.T, shares, strict=True):
        in_doubt = is_misfit_in_runs(fit) or bool(share or before)
        rungs.append(Rung(name, float(errors.mean()), bootstrap_interval(added), share, in_doubt))
        before = share
    costliest = max(rungs[1:], key=lambda rung: rung.increment_m2.mean).name
    return ErrorBudget(scenario, filter_name, len(table), tuple(rungs), costliest, fit)


def rung_errors(scenario: Scenario, seed: int, chosen: str | Asked, lag: int | None = None) -> RungErrors:
    """Run all rungs on one run; equal rungs are run once."""
    (asked,) = ask([chosen])
    truth, recording, exact = simulate_informed(scenario, seed)
    assert truth.poses is not None and truth.association is not None and truth.misleading is not None
    known = np.where(truth.misleading, NOBODY, truth.association)
    exact = exact.associated(known)
    initialisation, robust = scenario.initialisation_settings, scenario.robustness
    try:
        slam = load(asked, scenario.association, initialisation, robust=robust, announced=False)
        hindsight = _run(HINDSIGHT, exact)
        causal = _run(CAUSAL, exact)
        assuming = causal if scenario.assumed == Assumed() else _run(CAUSAL, recording.associated(known))
        estimate = run_estimator(asked.label, slam, recording)[0]
        own = known if estimate.association is None else estimate.association
        associating = assuming if np.array_equal(own, known) else _run(CAUSAL, recording.associated(own))
        windows = [] if lag is None else [_run(f"{FIXED_LAG}-{lag}", recording.associated(own))]
    except UserError as error:
        raise UserError(f"run with seed {seed}: {error}") from error
    rungs = (hindsight, causal, assuming, associating, *windows, estimate)
    errors = np.array([np.square(pose_errors(truth.poses, each.poses)[:, :2]).sum(axis=1).mean() for each in rungs])
    checks = np.array([each.optimum_check for each in rungs], dtype=np.float64)
    fit = Measured(truth, recording, hindsight).chi_square_per_dof()
    return RungErrors(errors, checks, np.nan if fit is None else fit)


def _run(name: str, recording: Recording) -> Estimate:
    return run_estimator(name, load(ask([name])[0]), recording)[0]


def budget_table(budget: ErrorBudget) -> Page:
    """Return the table of the rungs, the verdict and the notes."""
    return Page((rung_table(budget), "", verdict(budget), *notes(budget)))


def rung_table(budget: ErrorBudget) -> Table:
    """Return the errors of the rungs."""
    any_doubt, rows = any(rung.in_doubt for rung in budget.rungs), list[list[Cell | str]]()
    for rung in budget.rungs:
        added = rung.increment_m2
        adds = marked(Cell(f"{added.mean:+.5f}", added.mean), rung.in_doubt if any_doubt else None)
        interval = from_to(added.low, added.high, "{:+.5f}")
        rows.append([rung.name, Cell(f"{rung.mse_m2:.5f}", rung.mse_m2), adds, interval, RUNGS[rung.name]])
    return Table.of(HEADS, rows, "Rung by rung", "budget")


def notes(budget: ErrorBudget) -> list[str]:
    """Return lines on optima that do not fit the stated noise, and on rungs whose optima are in doubt."""
    misfit = misfits([HINDSIGHT, CAUSAL]) if is_misfit_in_runs(budget.fit) else None
    lines = at_places(CAUSAL, {rung.name: rung.optimum_check_share for rung in budget.rungs})
    return [misfit, *lines] if misfit else lines


def verdict(budget: ErrorBudget) -> str:
    """Return a sentence that names the costliest rung, and whether its cost is significant."""
    total, unavoidable = budget.rungs[-1].mse_m2, budget.rungs[0].mse_m2
    costliest = next(rung for rung in budget.rungs if rung.name == budget.costliest)
    cost, low = costliest.increment_m2.mean, costliest.increment_m2.low
    opening = (
        f"{budget.filter} on {budget.scenario}, {budget.runs} runs: mean squared error {total:.4f} m^2 "
        f"(RMS {np.sqrt(total):.3f} m), {unavoidable:.4f} m^2 of it unavoidable"
    )
    if cost <= 1e-9 * total:  # rounding
        return f"{opening}; no other rung adds to it."
    mark = MARK if costliest.in_doubt else ""
    share = f"{cost:.4f}{mark} m^2, {cost / total:.0%}{mark} of the total"
    doubt = "" if low is not None and low > 0.0 else f", not significantly above 0 in {counted(budget.runs, 'run')}"
    return f"{opening}; the largest other part is {budget.costliest}: {share}{doubt}."
