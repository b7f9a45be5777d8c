"""Monte Carlo: independent runs of a scenario, carried by any executor, kept in a store that survives anything."""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import closing
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from slamgauge.compare.estimators.memory_check import require_room_for_runs
from slamgauge.compare.estimators.requests import Asked, Chosen, ask, labels_among
from slamgauge.compare.scenarios.scenario import Scenario, sampled
from slamgauge.compare.scenarios.scenario_text import scenario_text
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.scoring.sequential import Look
from slamgauge.compare.storage.manifest import require_free
from slamgauge.compare.storage.progress import counted
from slamgauge.compare.storage.result_files import STORE, STORE_FILES
from slamgauge.compare.storage.staged_folder import begin_file
from slamgauge.compare.studies.executors import lost_worker
from slamgauge.compare.studies.stopping_rule import (
    Pair,
    Precision,
    Until,
    compare_against,
    looks_of,
    pairs_to_resolve,
    ratios_at,
)
from slamgauge.compare.studies.store import StudyStore, begin_store, digest, open_store
from slamgauge.compare.studies.store_damage import require_whole
from slamgauge.compare.studies.store_file import sole_use
from slamgauge.compare.studies.study_run import Outcome, run_once, run_seed
from slamgauge.compare.studies.summary import Failure, Summary, summarise
from slamgauge.errors import UserError

IN_FLIGHT = 256  # runs handed to the executor at a time, so that results do not pile up
MOST_LOST = 3  # workers in a row that die at a single run: it is not the run then
AGAIN = "not stored: the same command carries it out again"


class _Work(NamedTuple):
    """Runs of a study: what is simulated and estimated, and where."""

    scenario: Scenario
    seed: int
    asked: list[Asked]
    executor: Executor


_Task = tuple[int, list[Asked]]  # a run, and the estimators that it is still to be given to


def run_study(
    scenario: Scenario | str | Path,
    runs: int,
    seed: int,
    estimators: Chosen,
    out: str | Path,
    executor: Executor,
    *,
    against: Sequence[str] = (),
    until: Until | None = None,
) -> Summary:
    """Carry out the runs that the store in `out` lacks, and sum up the first `runs` of them.

    An estimator's error is stored as what became of the run. What the machine refused (memory, room, a worker that
    died) is named among the failures and not stored: the same command carries it out again.

    Eight parameters: six say what to run and where, the last two are options by keyword.

    Args:
        scenario: what to simulate; draw the true start from the prior (`start = "sampled"`) for any
            statement about consistency, as is done with one that is given by its name or path.
        runs: how many; their seeds are spawned from `seed`, the same whatever the number.
        seed: the study's root seed.
        estimators: what `load_estimators` takes, people's own among it, whose results are kept under a digest of
            their code: edited code is another estimator. All see the same measurements, the optima with their true
            noise and associations.
        out: folder of `study.sqlite`.
        executor: carries the runs, for example `executors.local_processes(2)`.
        against: labels of the estimators that the others are compared with, run by run.
        until: go on after the first `runs` until every ratio is known as well as that; it is looked at after numbers of
            runs that are fixed beforehand, so that a study that was killed ends where it would have ended.

    Raises:
        UserError: bad names or numbers, a store that holds another study, or that another command is at work on, a file
            in its place that is not ours, or workers that die whatever they carry.
    """
    scenario, out = sampled(scenario), Path(out)
    asked = ask(estimators)  # misspelt names are refused before anything is written
    if not asked:
        raise UserError("estimators: none given; name at least one, for example --estimators ekf,causal")
    if runs < 1:
        raise UserError(f"runs: {runs} is no study; give at least 1")
    if seed < 0:
        raise UserError(f"seed: {seed} is negative; use a whole number >= 0")
    against = labels_among(against, [each.label for each in asked], "is not among --estimators")
    require_room_for_runs(runs if until is None else max(runs, until.most), scenario, len(asked))
    looks, pairs = looks_of(runs, until), pairs_to_resolve(asked, against) if until is not None else []
    require_free(out, STORE_FILES)
    begin_file(out, STORE)
    with sole_use(out / STORE):
        begin_store(out / STORE, scenario, seed)
        with open_store(out / STORE, scenario, seed) as store:
            look, precision, refused = _carry_out_looks(
                store, _Work(scenario, seed, asked, executor), looks, pairs, until
            )
            loaded = {each.label: store.load(each.key, look.runs) for each in asked}
            found = [*(Failure(*each) for each in store.failures(look.runs)), *refused]
    labels = {each.key: each.label for each in asked}
    failures = [replace(each, estimator=labels[each.estimator]) for each in found if each.estimator in labels]
    failures.sort(key=lambda failure: (failure.run, failure.estimator))
    return Summary(
        scenario=scenario.name,
        runs=look.runs,
        seed=seed,
        digest=digest(scenario, seed),
        failures=tuple(failures),
        estimators=summarise(loaded),
        against=compare_against(loaded, against, looks, look),
        precision=precision,
        scenario_text=scenario_text(scenario),
    )


def load_runs(
    scenario: Scenario | str | Path, runs: int, seed: int, estimators: Chosen, out: str | Path
) -> dict[str, Runs]:
    """What the store in `out` holds of each estimator, for figures and statistics of one's own.

    Raises:
        UserError: there is none, it is another study's, or it is damaged.
    """
    scenario, out = sampled(scenario), Path(out)
    if not (out / STORE).exists():
        raise UserError(f"{out / STORE}: there is no study; carry one out with run_study")
    with open_store(out / STORE, scenario, seed) as store:
        require_whole(out / STORE)
        return {each.label: store.load(each.key, runs) for each in ask(estimators)}


def _carry_out_looks(
    store: StudyStore, work: _Work, looks: Sequence[Look], pairs: Sequence[Pair], until: Until | None
) -> tuple[Look, Precision | None, list[Failure]]:
    """Carry out runs up to the look at which enough is known, and return that, what is known, and what failed."""
    look, precision, refused = looks[0], None, list[Failure]()
    for look in looks:
        refused = _carry_out(store, work, look.runs)
        if until is not None:
            ates = {each.label: store.ates(each.key, look.runs) for each in work.asked}
            ratios = ratios_at(look, pairs, ates)
            precision = Precision(until, look, ratios, tuple(pair for pair in pairs if pair not in ratios))
        if precision is None or precision.is_settled:
            break
    return look, precision, refused


def _carry_out(store: StudyStore, work: _Work, runs: int) -> list[Failure]:
    """Hand out the missing runs, and store each as it arrives; what failed and is not stored is returned.

    When a worker dies, all that its pool carried is lost. Those runs are carried out again one at a time, which
    tells the one that takes its worker with it from the others.
    """
    stored = store.stored()
    keys = {each.key for each in work.asked}
    whole = Counter(run for run, key in stored if run < runs and key in keys)
    there = sum(count == len(keys) for count in whole.values())
    to_do = ((run, [each for each in work.asked if (run, each.key) not in stored]) for run in range(runs))
    progress = counted(runs, "run", work.scenario.name, there, leave=True)
    refused: list[Failure] = []
    lost: list[_Task] = []
    in_a_row = 0
    with progress:
        with closing(_carried((task for task in to_do if task[1]), IN_FLIGHT, work)) as arriving:
            for task, done in arriving:
                if done is None:
                    lost.append(task)
                else:
                    refused += _kept(store, task[0], work.seed, done)
                    progress.update()
        lost.sort(key=lambda task: task[0])
        with closing(_carried(lost, 1, work)) as arriving:
            for (run, estimators), done in arriving:
                in_a_row = in_a_row + 1 if done is None else 0
                if in_a_row == MOST_LOST:
                    raise UserError(
                        f"a worker process died {MOST_LOST} times in a row, the last time at run {run} alone "
                        "(out of memory?); make room, and give the same command again"
                    )
                error = Outcome("", error="its worker process died (out of memory?)", transient=True)
                refused += _kept(
                    store, run, work.seed, done or [replace(error, estimator=each.key) for each in estimators]
                )
                progress.update()
    return refused


def _kept(store: StudyStore, run: int, seed: int, outcomes: list[Outcome]) -> list[Failure]:
    """Store what became of a run, and return the failures that are not stored."""
    store.add(run, run_seed(seed, run), outcomes)
    return [Failure(run, each.estimator, f"{each.error} ({AGAIN})") for each in outcomes if each.transient]


def _carried(to_do: Iterable[_Task], in_flight: int, work: _Work) -> Generator[tuple[_Task, list[Outcome] | None]]:
    """What became of each run, as it arrives; None if its worker died."""
    pending: dict[Future[list[Outcome]], _Task] = {}
    waiting = iter(to_do)
    try:
        while True:
            for run, asked in islice(waiting, in_flight - len(pending)):
                pending[work.executor.submit(run_once, work.scenario, run_seed(work.seed, run), asked)] = (run, asked)
            if not pending:
                return
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                task = pending.pop(future)
                error = future.exception()
                yield task, None if error is not None and lost_worker(error) else future.result()
    finally:
        for future in pending:
            future.cancel()
