"""Monte Carlo: independent runs of a scenario, carried by any executor, kept in a store that survives anything."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from pathlib import Path

from slamgauge.compare.estimators.estimators import load_estimators
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.storage.files import explained, write_json
from slamgauge.compare.studies.run import Outcome, run_once, run_seed
from slamgauge.compare.studies.store import Runs, StudyStore, digest, open_store
from slamgauge.compare.studies.summary import Failure, Summary, summarise
from tqdm import tqdm

from slamgauge.errors import UserError

IN_FLIGHT = 256  # runs handed to the executor at a time, so that results do not pile up
STORE = "study.sqlite"


def run_study(
    scenario: Scenario, runs: int, seed: int, estimators: Sequence[str], out: Path, executor: Executor
) -> Summary:
    """Carry out the runs that the store in `out` lacks, and sum up the first `runs` of them.

    Args:
        scenario: what to simulate; draw the true start from the prior (`start = "sampled"`) for any
            statement about consistency.
        runs: how many; their seeds are spawned from `seed`, the same whatever the number.
        seed: the study's root seed.
        estimators: names of `load_estimators`; all see the same measurements, the optima with their true noise
            and associations.
        out: folder of `study.sqlite`.
        executor: carries the runs, for example `executors.local_processes(2)`.

    Raises:
        UserError: bad names or numbers, or a store that holds another study.
    """
    load_estimators(estimators)  # misspelt names are refused before anything is written
    if not estimators:
        raise UserError("estimators: none given; name at least one, for example --estimators ekf,isam2")
    if runs < 1:
        raise UserError(f"runs: {runs} is no study; give at least 1")
    if seed < 0:
        raise UserError(f"seed: {seed} is negative; use a whole number >= 0")
    with open_store(out / STORE, scenario, seed) as store:
        _carry_out(store, scenario, runs, seed, estimators, executor)
        loaded = {name: store.load(name, runs) for name in estimators}
        failures = [Failure(*each) for each in store.failures(runs) if each[1] in estimators]
    return Summary(
        scenario=scenario.name,
        runs=runs,
        seed=seed,
        digest=digest(scenario, seed),
        failures=tuple(failures),
        estimators=summarise(loaded),
    )


def load_runs(scenario: Scenario, runs: int, seed: int, estimators: Sequence[str], out: Path) -> dict[str, Runs]:
    """What the store in `out` holds of each estimator, for figures and statistics of one's own."""
    if not (out / STORE).exists():
        raise UserError(f"{out / STORE}: there is no study; carry one out with run_study")
    with open_store(out / STORE, scenario, seed) as store:
        return {name: store.load(name, runs) for name in estimators}


def write_study(out: Path, summary: Summary, runs: dict[str, Runs], step: float) -> None:
    """Write summary.json and the figures into `out`; `step` is the time step [s]."""
    from slamgauge.compare.figures.study_figures import save_study_figures  # matplotlib only where pictures are made

    with explained(out, "written"):
        save_study_figures(out, summary, runs, step)
    write_json(out / "summary.json", summary.to_json())


def _carry_out(
    store: StudyStore, scenario: Scenario, runs: int, seed: int, estimators: Sequence[str], executor: Executor
) -> None:
    """Hand out the missing runs, and store each as it arrives."""
    stored = store.stored()
    missing = {run: [name for name in estimators if (run, name) not in stored] for run in range(runs)}
    to_do = [(run, names) for run, names in missing.items() if names]
    progress = tqdm(total=runs, initial=runs - len(to_do), disable=None, unit="run", desc=scenario.name)
    pending: dict[Future[list[Outcome]], int] = {}
    waiting = iter(to_do)
    with progress:
        try:
            while _hand_out(pending, waiting, scenario, seed, executor):
                done, _ = wait(pending, return_when=FIRST_COMPLETED)
                for future in done:
                    run = pending.pop(future)
                    store.add(run, run_seed(seed, run), future.result())
                    progress.update()
        finally:
            for future in pending:
                future.cancel()


def _hand_out(
    pending: dict[Future[list[Outcome]], int],
    waiting: Iterator[tuple[int, list[str]]],
    scenario: Scenario,
    seed: int,
    executor: Executor,
) -> bool:
    """Top up the runs in flight; False when nothing is left to wait for."""
    while len(pending) < IN_FLIGHT:
        following = next(waiting, None)
        if following is None:
            break
        run, names = following
        pending[executor.submit(run_once, scenario, run_seed(seed, run), names)] = run
    return bool(pending)
