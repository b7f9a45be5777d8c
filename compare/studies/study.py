"""Monte Carlo studies: independent runs of a scenario on any executor, kept in a store so that they can be resumed."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterable, Sequence
from concurrent.futures import Executor, Future
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from slamgauge.compare.estimators.registry import BOUNDS
from slamgauge.compare.estimators.requests import Asked, Chosen, UserCode, ask, labels_among
from slamgauge.compare.estimators.running import require_room_for_runs, tell_remarks, try_out
from slamgauge.compare.scenarios.scenario import Scenario, as_scenario, scenario_text
from slamgauge.compare.scenarios.simulation import informed, simulate
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.storage.progress import counted
from slamgauge.compare.storage.result_files import STORE
from slamgauge.compare.storage.staged_folder import begin_folder
from slamgauge.compare.studies.executors import first_done, lost_worker
from slamgauge.compare.studies.paired_comparisons import compare_user_code, run_figures
from slamgauge.compare.studies.store import StudyStore, digest, open_store, sole_use
from slamgauge.compare.studies.study_run import Outcome, require_numbers, run_once, run_seed
from slamgauge.compare.studies.summary import Failure, Summary, summarise
from slamgauge.errors import UserError

IN_FLIGHT = 256  # runs submitted to the executor at a time, which limits the memory of waiting results
MOST_LOST = 3  # workers that die one after another: then the run is not the cause
AGAIN = "not stored: the same command runs it again"
DIED = Outcome("", error="its worker process died (out of memory?)", transient=True)


class _Work(NamedTuple):
    """A study's scenario, root seed, estimators and executor."""

    scenario: Scenario
    seed: int
    asked: list[Asked]
    executor: Executor


_Task = tuple[int, list[Asked]]  # number of a run, and the estimators without a stored result in it


def run_study(
    scenario: Scenario | str | Path,
    runs: int,
    seed: int,
    estimators: Chosen,
    out: str | Path,
    executor: Executor,
    *,
    against: Sequence[str] = (),
) -> Summary:
    """Run what the store in `out` lacks, and summarise the first `runs` runs.

    An estimator's error is stored as its outcome of the run. A failure of the machine (memory, disk, a worker that
    died) is among the failures and not stored: the same command runs it again.

    Args:
        scenario: use `start = "sampled"` (true start drawn from the prior) for any statement about consistency; a
            scenario given by name or path has it.
        runs: number of runs; their seeds are spawned from `seed`, the same for any number.
        seed: root seed of the study.
        estimators: see `load_estimators`. Results of user code are stored under a digest of the code: edited code is
            another estimator. All see the same measurements, the optima with their true noise and associations.
        out: folder of `study.sqlite`.
        executor: for example `executors.local_processes(2)`.
        against: labels of the estimators that the others are compared with, run by run.

    Raises:
        UserError: bad names or numbers, a store of another study, a store in use by another command, a foreign file in
            its place, or workers that die at every run.
    """
    scenario, out = as_scenario(scenario), Path(out)
    asked = ask(estimators)  # misspelt names are refused before anything is written
    if not asked:
        raise UserError("estimators: none given; name at least one, for example --estimators ekf,causal")
    require_numbers(runs, seed)
    against = labels_among(against, [each.label for each in asked], "is not among --estimators")
    require_room_for_runs(runs, scenario, len(asked))
    begin_folder(out)
    with sole_use(out / STORE), open_store(out / STORE, scenario, seed, begin=True) as store:
        refused = _run_missing(store, _Work(scenario, seed, asked, executor), runs)
        loaded = {each.label: store.load(each.key, runs) for each in asked}
        found = [*(Failure(*each) for each in store.failures(runs)), *refused]
    labels = {each.key: each.label for each in asked}
    failures = [replace(each, estimator=labels[each.estimator]) for each in found if each.estimator in labels]
    per_run = {label: run_figures(each) for label, each in loaded.items()}
    compared = [label for label in per_run if label not in BOUNDS]
    return Summary(
        scenario=scenario.name,
        runs=runs,
        seed=seed,
        digest=digest(scenario, seed),
        failures=tuple(sorted(failures)),
        estimators=summarise(loaded),
        against={
            name: {label: per_run[label].against(per_run[name]) for label in compared if label != name}
            for name in against
        },
        scenario_text=scenario_text(scenario),
        comparisons=compare_user_code(asked, loaded, per_run),
        per_run=per_run,
        loaded=loaded,
    )


def run_beside_optima(
    scenario: Scenario, asked: Sequence[Asked], runs: int, seed: int, places: tuple[Path, Path], executor: Executor
) -> Summary:
    """Run a study whose optima have a store of their own, which scenarios with the same measurements share.

    `asked` has an estimator that receives the recording only; `places` are the folders of these and of the optima.
    """
    from slamgauge.jit import stored_files  # here: it loads numba

    optima = [each for each in asked if each.is_told]
    work = [(scenario, [each for each in asked if not each.is_told], places[0])]
    if optima:
        work.append((informed(scenario), optima, places[1]))
    if not stored_files():  # on first use compile the kernels of filters and optima at the same time
        for begun in [executor.submit(run_once, each, run_seed(seed, 0), chosen) for each, chosen, _ in work]:
            first_done([begun])
    parts = [run_study(each, runs, seed, chosen, place, executor) for each, chosen, place in work]
    loaded = {name: found for part in parts for name, found in part.loaded.items()}
    failures = tuple(failure for part in parts for failure in part.failures)
    return replace(parts[0], failures=failures, estimators=summarise(loaded), per_run={}, loaded=loaded)


def load_runs(
    scenario: Scenario | str | Path, runs: int, seed: int, estimators: Chosen, out: str | Path
) -> dict[str, Runs]:
    """Return the stored runs of each estimator, for your own figures and statistics; arguments as in `run_study`.

    `runs.figures["ate_m"]` is an array (R,) over runs, `runs.series["nees_pose"]` one (R, N+1) over runs and steps.

    Raises:
        UserError: the store does not exist, has another study, or cannot be used.
    """
    path = Path(out) / STORE
    if not path.exists():
        raise UserError(f"{path}: no study is there; make one with run_study")
    with open_store(path, as_scenario(scenario), seed) as store:
        return {each.label: store.load(each.key, runs) for each in ask(estimators)}


def _run_missing(store: StudyStore, work: _Work, runs: int) -> list[Failure]:
    """Run the missing runs, store each run as it arrives, and return the failures that are not stored."""
    stored = store.stored()
    labels = {each.key: each.label for each in work.asked}
    missing: list[_Task] = []
    for run in range(runs):
        asked = [each for each in work.asked if (run, each.key) not in stored]
        if asked:
            missing.append((run, asked))
    if missing:
        for each in (each for each in work.asked if isinstance(each, UserCode)):
            try_out(each, simulate(work.scenario, run_seed(work.seed, 0))[1])
    refused: list[Failure] = []
    with (
        counted(runs, "run", work.scenario.name, runs - len(missing), leave=True) as progress,
        closing(_arriving(missing, work)) as arriving,
    ):
        for run, outcomes in arriving:
            for each in outcomes:
                tell_remarks(labels[each.estimator], each.remarks)
                if each.transient:
                    refused.append(Failure(run, each.estimator, f"{each.error} ({AGAIN})"))
            store.add(run, run_seed(work.seed, run), outcomes)
            progress.update()
    return refused


def _arriving(tasks: Iterable[_Task], work: _Work) -> Generator[tuple[int, list[Outcome]]]:
    """Submit tasks; yield the number of each run with its outcomes as they arrive."""
    from slamgauge.jit import stored_files  # here: it loads numba

    waiting = deque(tasks)
    pending: dict[Future[list[Outcome]], _Task] = {}
    in_a_row = 0  # workers that died, one after another
    limit = IN_FLIGHT if stored_files() else 1  # the first one compiles the kernels, which the others load
    try:
        while waiting or pending:
            while waiting and len(pending) < limit:
                run, asked = waiting.popleft()
                future = work.executor.submit(run_once, work.scenario, run_seed(work.seed, run), asked)
                pending[future] = run, asked
            limit = IN_FLIGHT
            for future in sorted(first_done(pending), key=lambda each: each.exception() is not None):  # defects last
                run, asked = pending.pop(future)
                is_lost = lost_worker(future.exception())
                in_a_row = in_a_row + 1 if is_lost else 0
                if in_a_row == MOST_LOST:
                    what = f"{MOST_LOST} worker processes died one after another, the last one at run {run}"
                    remedy = "make room or give fewer --jobs, and give the same command again"
                    raise UserError(f"{what} (out of memory?); {remedy}")
                yield run, [replace(DIED, estimator=each.key) for each in asked] if is_lost else future.result()
    finally:
        for future in pending:
            future.cancel()
