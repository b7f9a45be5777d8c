"""The error budget: a filter's mean squared error split rung by rung, each rung run on the same measurements.

hindsight optimum -> causal optimum -> with the noise the filter assumes -> with the associations it makes
-> if asked for, a smoother of the last steps alone -> the filter itself. What a rung adds to the mean squared
position error is what it costs. The associations are those that stand at the end, after deletion and merging.
"""

from __future__ import annotations

from collections import deque
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.loading import load
from slamgauge.compare.estimators.registry import CAUSAL, FILTERS, FIXED_LAG, HINDSIGHT
from slamgauge.compare.estimators.requests import Asked, ask
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.scenarios.scenario import Scenario, sampled
from slamgauge.compare.scenarios.scenario_text import scenario_text
from slamgauge.compare.scenarios.schema import Assumed
from slamgauge.compare.scenarios.simulation import simulate_informed
from slamgauge.compare.scoring.intervals import Interval, bootstrap_interval, mean_interval
from slamgauge.compare.scoring.optimum_figures import chi_square_per_dof, is_misfit_in_runs, share_of_doubt
from slamgauge.compare.scoring.optimum_notes import MARK, at_places, misfits
from slamgauge.compare.scoring.ray_figures import RayFigures, describe, mean_figures, ray_figures
from slamgauge.compare.scoring.text_page import Grid, Page
from slamgauge.compare.scoring.text_table import marked
from slamgauge.compare.scoring.trajectory_error import pose_errors, squared_distances
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.progress import tracked
from slamgauge.compare.storage.provenance import origin
from slamgauge.compare.storage.result_files import BUDGET
from slamgauge.compare.studies.store import digest
from slamgauge.compare.studies.study import IN_FLIGHT
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.display import counted
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.memory import require_memory
from slamgauge.recording import Recording
from slamgauge.truth import NOBODY, Truth
from slamgauge.validation import require_lag

RUNGS = {
    "hindsight optimum": "all measurements at once: what no estimator avoids",
    "causal optimum": "for knowing only the past",
    "assumed noise": "for believing other noise than there is",
    "own associations": "for taking landmarks for others",
    FIXED_LAG: "for leaving what is older than the lag as it was",
    "linearisation": "for being a filter: its own linearisation",
}
BYTES = 1000  # of what is known of a run


@dataclass(frozen=True)
class Rung:
    """One step of the budget: its mean squared position error [m^2], and what it adds, with 95 % interval.

    `optimum_check_share` is the share of runs in which the causal optimum that it is, is in doubt; None if it is none.
    """

    name: str
    mse_m2: float
    increment_m2: Interval
    optimum_check_share: float | None = None


@dataclass(frozen=True)
class ErrorBudget:
    """The budget of one filter on one scenario; `costliest` is the rung above the first that adds most.

    Its rungs are those of `RUNGS`, that of the fixed lag where one was asked for.
    `fit` is chi2/dof of the hindsight optimum, `rays` what became of the rays of a bearing-only filter, both in the
    mean over runs; `scenario_text` is the scenario as a TOML file, `seed` the root of the runs' own,
    `digest` that of all that decides them.
    """

    scenario: str
    filter: str
    runs: int
    rungs: tuple[Rung, ...]
    costliest: str
    fit: Interval | None
    rays: RayFigures | None = None
    scenario_text: str | None = None
    seed: int | None = None
    digest: str | None = None

    def to_json(self) -> dict[str, Any]:
        """The content of budget.json; `rays` for bearings alone."""
        doubtful = self.doubtful()
        rungs = [
            {
                "name": rung.name,
                "mse_m2": rung.mse_m2,
                "increment_m2": rung.increment_m2._asdict(),
                "optimum_check_share": rung.optimum_check_share,
                "in_doubt": rung.name in doubtful,
            }
            for rung in self.rungs
        ]
        content: dict[str, Any] = {
            **origin(self.scenario_text),
            "scenario": self.scenario,
            "filter": self.filter,
            "runs": self.runs,
            "seed": self.seed,
            "digest": self.digest,
            "rungs": rungs,
            "costliest": self.costliest,
            "chi_square_per_dof": None if self.fit is None else self.fit._asdict(),
            "verdict": verdict(self),
            "notes": notes(self),
        }
        return content if self.rays is None else {**content, "rays": self.rays._asdict()}

    def doubtful(self) -> set[str]:
        """Rungs whose addition starts or ends at an optimum in doubt; all, if the optima are none of what happened."""
        if is_misfit_in_runs(self.fit):
            return {rung.name for rung in self.rungs}
        starts = (None, *self.rungs[:-1])
        return {
            rung.name
            for start, rung in zip(starts, self.rungs, strict=True)
            if rung.optimum_check_share or (start is not None and start.optimum_check_share)
        }


def read_budget(folder: Path) -> ErrorBudget:
    """The budget that `slamgauge budget` has written into a folder.

    Raises:
        UserError: there is none, or it is not what that writes.
    """
    path = folder / BUDGET
    content = read_json(path, "budget")
    try:
        rungs = tuple(
            Rung(each["name"], each["mse_m2"], Interval(**each["increment_m2"]), each["optimum_check_share"])
            for each in content["rungs"]
        )
        fit, rays = content["chi_square_per_dof"], content.get("rays")
        return ErrorBudget(
            *(content["scenario"], content["filter"], content["runs"], rungs, content["costliest"]),
            fit=None if fit is None else Interval(**fit),
            rays=None if rays is None else RayFigures(**rays),
            scenario_text=content["scenario_text"],
            seed=content.get("seed"),
            digest=content.get("digest"),
        )
    except (KeyError, TypeError):
        raise UserError(f"{path}: not what `slamgauge budget` writes; run it again") from None


class RungErrors(NamedTuple):
    """One run of a budget: mean squared errors (n,) [m^2], a rung each, their optima's checks (n,), and the rays.

    `fit` is chi2/dof of the hindsight optimum, NaN where it does not tell.
    """

    errors: Float
    checks: Float
    fit: float
    rays: RayFigures | None


def error_budget(
    scenario: Scenario | str | Path,
    filter_name: str,
    runs: int,
    seed: int,
    executor: Executor,
    lag: int | None = None,
) -> ErrorBudget:
    """The budget of a filter, one's own by its address too, over `runs` runs whose seeds are spawned from `seed`.

    With a `lag` [steps] the smoother of so many steps is a rung, too. Intervals are bootstrapped over runs.

    Raises:
        UserError: bad names or numbers, or an estimator that failed, with the run.
    """
    scenario = sampled(scenario)
    asked = rungs_of(filter_name, lag)[-1]
    if asked.name and asked.name not in FILTERS:
        raise UserError(
            f"filter: {filter_name!r} is not a filter whose error can be split; use {', '.join(FILTERS)}, or your own"
        )
    if runs < 1:
        raise UserError(f"runs: {runs} is no budget; give at least 1")
    if seed < 0:
        raise UserError(f"seed: {seed} is negative; use a whole number >= 0")
    require_memory(1.0 * BYTES * runs, f"runs: a budget of {runs}", "give fewer")
    results: list[RungErrors] = []
    pending: deque[Future[RungErrors]] = deque()
    try:
        for run in tracked(range(runs), runs, "run", scenario.name, leave=True):
            for ahead in range(run + len(pending), min(run + IN_FLIGHT, runs)):
                pending.append(executor.submit(rung_errors, scenario, run_seed(seed, ahead), asked, lag))
            results.append(pending.popleft().result())
    finally:
        for future in pending:
            future.cancel()
    errors, checks, fits, rays = zip(*results, strict=True)
    budget = summarise_budget(scenario.name, asked.label, np.array(errors), np.array(checks), np.array(fits))
    found = {"scenario_text": scenario_text(scenario), "seed": seed, "digest": digest(scenario, seed)}
    return replace(budget, rays=mean_figures(rays), **found)


def summarise_budget(scenario: str, filter_name: str, table: Float, checks: Float, fits: Float) -> ErrorBudget:
    """The budget of mean squared errors (runs, n) [m^2], a column per rung, of checks likewise, and of fits (runs,).

    Five columns are all rungs but that of a fixed lag. Checks and fits that are not told are NaN.
    """
    names = [name for name in RUNGS if name != FIXED_LAG or table.shape[1] == len(RUNGS)]
    increments = np.diff(table, axis=1, prepend=0.0)
    rungs = tuple(
        Rung(name, float(errors.mean()), bootstrap_interval(added), share_of_doubt(check))
        for name, errors, added, check in zip(names, table.T, increments.T, checks.T, strict=True)
    )
    costliest = max(rungs[1:], key=lambda rung: rung.increment_m2.mean).name
    return ErrorBudget(scenario, filter_name, len(table), rungs, costliest, mean_interval(fits))


def rungs_of(chosen: str | Asked, lag: int | None = None) -> list[Asked]:
    """The estimators of a run: the optima of the rungs, the smoother of so many steps if there is one, the filter.

    Raises:
        UserError: an unknown name, or a lag of no step.
    """
    smoothers = [] if lag is None else [_of_lag(lag)]
    return [*ask([HINDSIGHT]), *3 * ask([CAUSAL]), *ask([*smoothers, chosen])]


def _of_lag(lag: int) -> str:
    return f"{FIXED_LAG}-{require_lag(lag)}"


def rung_errors(scenario: Scenario, seed: int, chosen: str | Asked, lag: int | None = None) -> RungErrors:
    """What the rungs make of one run; those that coincide are run once."""
    (asked,) = ask([chosen])
    truth, recording, told = simulate_informed(scenario, seed)
    assert truth.association is not None and truth.misleading is not None
    trusted = np.where(truth.misleading, NOBODY, truth.association)
    believed, told = recording.associated(trusted), told.associated(trusted)
    try:
        slam = load(
            asked, scenario.association, scenario.initialisation_settings, robust=scenario.robustness, announced=False
        )
        hindsight = _run(HINDSIGHT, told)
        causal = _run(CAUSAL, told)
        assuming = causal if scenario.assumed == Assumed() else _run(CAUSAL, believed)
        estimate = run_estimator(asked.label, slam, recording)[0]
        own = estimate.association
        if own is None or np.array_equal(own, trusted):
            associating = assuming
        else:
            associating = _run(CAUSAL, recording.associated(own))
        associated = recording.associated(trusted if own is None else own)
        windows = [] if lag is None else [_run(_of_lag(lag), associated)]
    except UserError as error:
        raise UserError(f"run with seed {seed}: {error}") from error
    rungs = (hindsight, causal, assuming, associating, *windows, estimate)
    errors = np.array([_mse(truth, each) for each in rungs])
    checks = np.array([each.optimum_check for each in rungs], dtype=np.float64)
    fit = chi_square_per_dof(truth, told, hindsight)
    return RungErrors(errors, checks, np.nan if fit is None else fit, ray_figures(truth, recording, estimate))


def _run(name: str, recording: Recording) -> Estimate:
    return run_estimator(name, load(ask([name])[0]), recording)[0]


def _mse(truth: Truth, estimate: Estimate) -> float:
    assert truth.poses is not None
    return float(squared_distances(pose_errors(truth.poses, estimate.poses)).mean())


def budget_table(budget: ErrorBudget) -> Page:
    """The rungs, what each adds, and a sentence that says which costs most."""
    rows = [("rung", "mse [m^2]", "adds [m^2]", "95 % interval", "for")]
    doubtful = budget.doubtful()
    for rung in budget.rungs:
        added, low, high = rung.increment_m2
        interval = "-" if low is None or high is None else f"{low:+.5f} to {high:+.5f}"
        adds = f"{added:+.5f}"
        if doubtful:
            adds = marked(adds, MARK, is_marked=rung.name in doubtful)
        rows.append((rung.name, f"{rung.mse_m2:.5f}", adds, interval, RUNGS[rung.name]))
    return Page((Grid(rows, words=(0, 4), sentences=4), "", verdict(budget), *notes(budget)))


def notes(budget: ErrorBudget) -> list[str]:
    """What became of the rays, and what is in doubt."""
    return [*([] if budget.rays is None else [f"Per run {describe(budget.rays)}."]), *doubts(budget)]


def doubts(budget: ErrorBudget) -> list[str]:
    """That the optima are none of what has happened; which rungs are optima in doubt, in which share of the runs."""
    misfit = misfits([HINDSIGHT, CAUSAL]) if is_misfit_in_runs(budget.fit) else None
    told = at_places(CAUSAL, {rung.name: rung.optimum_check_share for rung in budget.rungs})
    return [misfit, *told] if misfit else told


def verdict(budget: ErrorBudget) -> str:
    """Which rung costs most, and whether the runs show that it costs anything, in a sentence."""
    total, unavoidable = budget.rungs[-1].mse_m2, budget.rungs[0].mse_m2
    cost, low, _ = next(rung.increment_m2 for rung in budget.rungs if rung.name == budget.costliest)
    opening = (
        f"{budget.filter} on {budget.scenario}, {budget.runs} runs: of {total:.4f} m^2 (RMS {np.sqrt(total):.3f} m) "
        f"{unavoidable:.4f} m^2 no estimator avoids"
    )
    if cost <= 1e-9 * total:  # rounding
        return f"{opening}; no rung above that costs anything."
    mark = MARK if budget.costliest in budget.doubtful() else ""
    share = f"{cost:.4f}{mark} m^2, {cost / total:.0%}{mark} of the whole"
    if low is None or low <= 0.0:
        runs = counted(budget.runs, "run")
        return f"{opening}; most of the rest may go to {budget.costliest}: {share}, which {runs} cannot tell from 0."
    return f"{opening}; most of the rest goes to {budget.costliest}: {share}."
