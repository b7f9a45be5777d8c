"""The error budget: a filter's mean squared position error split into rungs, all run on the same measurements.

hindsight optimum -> causal optimum -> with the noise the filter assumes -> with the filter's associations
-> on request a fixed-lag smoother -> the filter. The cost of a rung is the error that it adds. The associations are
those at the end of the run, after deletion and merging.
"""

from __future__ import annotations

from collections import deque
from concurrent.futures import Executor, Future
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.loading import load
from slamgauge.compare.estimators.registry import CAUSAL, FILTERS, FIXED_LAG, HINDSIGHT
from slamgauge.compare.estimators.requests import Asked, BuiltIn, ask
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.scenarios.scenario import Scenario, as_scenario, scenario_text
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
from slamgauge.truth import NOBODY
from slamgauge.validation import require_lag

RUNGS = {
    "hindsight optimum": "unavoidable, even with all measurements",
    "causal optimum": "only past measurements",
    "assumed noise": "wrong assumed noise",
    "own associations": "wrong associations",
    FIXED_LAG: "steps before the lag are not relinearised",
    "linearisation": "linearisation of the filter",
}
BYTES = 1000  # memory for the results of a run


@dataclass(frozen=True)
class Rung:
    """One rung: its mean squared position error [m^2], and the error that it adds, with 95 % interval.

    `optimum_check_share` is the share of runs in which its causal optimum is in doubt; None for other rungs.
    """

    name: str
    mse_m2: float
    increment_m2: Interval
    optimum_check_share: float | None = None


@dataclass(frozen=True)
class ErrorBudget:
    """Error budget of a filter on a scenario.

    `rungs` split the mean squared error of `filter` over the `runs` of `scenario` into its causes [m²]; `costliest` is
    the rung after the first that adds most. `fit` is chi2/dof of the hindsight optimum, `rays` the figures of the
    rays of a bearing-only filter, both means over runs; `scenario_text` is the scenario as a TOML file, `seed` the
    root seed, `digest` that of both.
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
        """Return the content of budget.json; `rays` only for bearing-only filters."""
        doubtful = self.doubtful()
        rungs = [
            asdict(rung) | {"increment_m2": rung.increment_m2._asdict(), "in_doubt": rung.name in doubtful}
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
        """Return the rungs whose addition depends on an optimum in doubt; all if the optima do not fit the noise."""
        if is_misfit_in_runs(self.fit):
            return {rung.name for rung in self.rungs}
        starts = (None, *self.rungs[:-1])
        return {
            rung.name
            for start, rung in zip(starts, self.rungs, strict=True)
            if rung.optimum_check_share or (start is not None and start.optimum_check_share)
        }


def read_budget(folder: Path) -> ErrorBudget:
    """Read the budget that `slamgauge budget` has written into a folder.

    Raises:
        UserError: budget.json does not exist or is not valid.
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
    """One run of a budget: mean squared errors (n,) [m^2] of the rungs, checks (n,) of their optima, and the rays.

    `fit` is chi2/dof of the hindsight optimum; NaN if unknown.
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
    """Compute the budget of a built-in or user filter over `runs` runs; their seeds are spawned from `seed`.

    With a `lag` [steps] the fixed-lag smoother is a rung, too. Intervals are bootstrapped over runs.

    Raises:
        UserError: bad names or numbers, or an estimator that failed, with the run.
    """
    scenario = as_scenario(scenario)
    (asked,) = ask([filter_name])
    _smoother(lag)  # a bad lag is refused before any run
    if isinstance(asked, BuiltIn) and asked.name not in FILTERS:
        raise UserError(
            f"filter: {filter_name!r} is not a filter whose error can be split; use {', '.join(FILTERS)}, or your own"
        )
    if runs < 1:
        raise UserError(f"runs: {runs} is too few; give at least 1")
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
    """Compute the budget from mean squared errors (runs, n) [m^2], checks (runs, n) and fits (runs,); n = 5 or 6 rungs.

    Five columns are all rungs without the fixed lag. Unknown checks and fits are NaN.
    """
    names = [name for name in RUNGS if name != FIXED_LAG or table.shape[1] == len(RUNGS)]
    increments = np.diff(table, axis=1, prepend=0.0)
    rungs = tuple(
        Rung(name, float(errors.mean()), bootstrap_interval(added), share_of_doubt(check))
        for name, errors, added, check in zip(names, table.T, increments.T, checks.T, strict=True)
    )
    costliest = max(rungs[1:], key=lambda rung: rung.increment_m2.mean).name
    return ErrorBudget(scenario, filter_name, len(table), rungs, costliest, mean_interval(fits))


def _smoother(lag: int | None) -> list[str]:
    """Return the name of the fixed-lag smoother, in a list; an empty list without lag."""
    return [] if lag is None else [f"{FIXED_LAG}-{require_lag(lag)}"]


def rung_errors(scenario: Scenario, seed: int, chosen: str | Asked, lag: int | None = None) -> RungErrors:
    """Run all rungs on one run; equal rungs are run once."""
    (asked,) = ask([chosen])
    truth, recording, exact = simulate_informed(scenario, seed)
    assert truth.association is not None and truth.misleading is not None
    known = np.where(truth.misleading, NOBODY, truth.association)
    exact = exact.associated(known)
    try:
        slam = load(
            asked, scenario.association, scenario.initialisation_settings, robust=scenario.robustness, announced=False
        )
        hindsight = _run(HINDSIGHT, exact)
        causal = _run(CAUSAL, exact)
        assuming = causal if scenario.assumed == Assumed() else _run(CAUSAL, recording.associated(known))
        estimate = run_estimator(asked.label, slam, recording)[0]
        own = known if estimate.association is None else estimate.association
        associating = assuming if np.array_equal(own, known) else _run(CAUSAL, recording.associated(own))
        windows = [_run(name, recording.associated(own)) for name in _smoother(lag)]
    except UserError as error:
        raise UserError(f"run with seed {seed}: {error}") from error
    rungs = (hindsight, causal, assuming, associating, *windows, estimate)
    assert truth.poses is not None
    errors = np.array([squared_distances(pose_errors(truth.poses, each.poses)).mean() for each in rungs])
    checks = np.array([each.optimum_check for each in rungs], dtype=np.float64)
    fit = chi_square_per_dof(truth, exact, hindsight)
    return RungErrors(errors, checks, np.nan if fit is None else fit, ray_figures(truth, recording, estimate))


def _run(name: str, recording: Recording) -> Estimate:
    return run_estimator(name, load(ask([name])[0]), recording)[0]


def budget_table(budget: ErrorBudget) -> Page:
    """Return the table of the rungs, the verdict and the notes."""
    rows = [("rung", "mse [m^2]", "adds [m^2]", "95 % interval", "cause")]
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
    """Return notes on the rays and on doubts."""
    return [*([] if budget.rays is None else [f"Per run {describe(budget.rays)}."]), *doubts(budget)]


def doubts(budget: ErrorBudget) -> list[str]:
    """Return lines on optima that do not fit the stated noise, and on rungs whose optima are in doubt."""
    misfit = misfits([HINDSIGHT, CAUSAL]) if is_misfit_in_runs(budget.fit) else None
    lines = at_places(CAUSAL, {rung.name: rung.optimum_check_share for rung in budget.rungs})
    return [misfit, *lines] if misfit else lines


def verdict(budget: ErrorBudget) -> str:
    """Return a sentence that names the costliest rung, and whether its cost is significant."""
    total, unavoidable = budget.rungs[-1].mse_m2, budget.rungs[0].mse_m2
    cost, low, _ = next(rung.increment_m2 for rung in budget.rungs if rung.name == budget.costliest)
    opening = (
        f"{budget.filter} on {budget.scenario}, {budget.runs} runs: mean squared error {total:.4f} m^2 "
        f"(RMS {np.sqrt(total):.3f} m), {unavoidable:.4f} m^2 of it unavoidable"
    )
    if cost <= 1e-9 * total:  # rounding
        return f"{opening}; no other rung adds to it."
    mark = MARK if budget.costliest in budget.doubtful() else ""
    share = f"{cost:.4f}{mark} m^2, {cost / total:.0%}{mark} of the total"
    doubt = "" if low is not None and low > 0.0 else f", not significantly above 0 in {counted(budget.runs, 'run')}"
    return f"{opening}; the largest other part is {budget.costliest}: {share}{doubt}."
