"""A folder of submissions graded on the same runs, side by side and apart from each other."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from slamgauge.compare.estimators.memory_check import require_room_for_runs
from slamgauge.compare.estimators.requests import Asked
from slamgauge.compare.grading.grades import Grade, grade
from slamgauge.compare.grading.submissions import Submission
from slamgauge.compare.grading.trial import ReferenceRun, Trial, examine, reference_run
from slamgauge.compare.scenarios.scenario import Scenario, scenario_text
from slamgauge.compare.storage.progress import counted
from slamgauge.compare.storage.provenance import origin
from slamgauge.compare.studies.executors import lost_worker
from slamgauge.compare.studies.store import digest
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.errors import UserError

T = TypeVar("T")

LOST = "the worker process that watched it died (out of memory?); make room and grade it again"


@dataclass(frozen=True)
class Grades:
    """What came out, submissions in the order of their names.

    Attributes:
        folder: of the submissions.
        scenario: its name.
        runs: how many.
        seed: root seed.
        reference: label of the reference.
        reference_grade: the reference held against itself: its own figures.
        grades: of the submissions.
        scenario_text: the scenario as a TOML file.
        digest: of scenario and root seed, which decide the runs.
    """

    folder: Path
    scenario: str
    runs: int
    seed: int
    reference: str
    reference_grade: Grade
    grades: tuple[Grade, ...]
    scenario_text: str | None = None
    digest: str | None = None

    def to_json(self) -> list[dict[str, Any]]:
        """A row for each submission, and where it comes from."""
        where = {"scenario": self.scenario, "seed": self.seed, "digest": self.digest, **origin(self.scenario_text)}
        return [each.to_json() | where for each in self.grades]


@dataclass(frozen=True)
class GradeSettings:
    """Runs on which submissions are graded.

    Attributes:
        scenario: what to simulate; draw the true start from the prior (`start = "sampled"`).
        runs: their number, at least 2; their seeds are spawned from `seed`, as those of a study.
        seed: root seed. Whoever knows seed and scenario can simulate the truth: use one that nobody knows.
        reference: estimator that a right submission is not shown to be worse than.
        timeout: largest time of a run of a submission [s].
    """

    scenario: Scenario
    runs: int
    seed: int
    reference: Asked
    timeout: float


def grade_folder(
    folder: Path, submissions: Sequence[Submission], settings: GradeSettings, executor: Executor
) -> Grades:
    """Grade submissions, each in a process of its own; nothing that they do keeps the others from being graded.

    Args:
        folder: where they lie.
        submissions: `submissions_in` it.
        settings: runs, reference and largest time.
        executor: carries submissions, one at a time for each of its workers.

    Raises:
        UserError: bad numbers, or a reference that gives no estimates.
    """
    scenario, runs, seed, reference = settings.scenario, settings.runs, settings.seed, settings.reference
    if runs < 2:
        raise UserError(f"runs: {runs} has no interval, and nothing could be judged by it; give at least 2")
    if seed < 0:
        raise UserError(f"seed: {seed} is negative; use a whole number >= 0")
    require_room_for_runs(runs, scenario, 1)
    seeds = [run_seed(seed, run) for run in range(runs)]
    arguments = [(scenario, each, reference) for each in seeds]
    measured = dict(_carried(executor, reference_run, arguments, "run"))
    lost = next((each for each in measured.values() if isinstance(each, Exception)), None)
    if lost is not None:
        raise UserError(f"reference {reference.label}: {lost}")
    references = [each for _, each in sorted(measured.items()) if isinstance(each, ReferenceRun)]
    optima, scores = [each.optimum for each in references], [each.reference for each in references]
    waiting = [(place, each) for place, each in enumerate(submissions) if each.where is not None]
    arguments = [(each.where, each.name, scenario, seeds, optima, settings.timeout) for _, each in waiting]
    trials = {place: Trial(reason=each.reason) for place, each in enumerate(submissions)}
    for number, trial in _carried(executor, examine, arguments, "submission"):
        trials[waiting[number][0]] = trial if isinstance(trial, Trial) else Trial(reason=LOST)
    return Grades(
        folder=folder,
        scenario=scenario.name,
        runs=runs,
        seed=seed,
        reference=reference.label,
        reference_grade=grade(reference.label, Trial(scores=scores), scores),
        grades=tuple(grade(each.name, trials[place], scores) for place, each in enumerate(submissions)),
        scenario_text=scenario_text(scenario),
        digest=digest(scenario, seed),
    )


def _carried(
    executor: Executor, work: Callable[..., T], arguments: Sequence[tuple[Any, ...]], unit: str
) -> Generator[tuple[int, T | Exception]]:
    """Number and result of each piece of work, as it arrives.

    When a worker dies, all that its pool carried is lost; that is done again, one after the other.
    """
    pending: dict[Future[T], int] = {executor.submit(work, *each): place for place, each in enumerate(arguments)}
    lost: list[int] = []
    with counted(len(pending), unit) as progress:
        try:
            for future in as_completed(pending):
                error = future.exception()
                if error is not None and lost_worker(error):
                    lost.append(pending[future])
                    continue
                yield pending[future], future.result()
                progress.update()
            for place in sorted(lost):
                again = executor.submit(work, *arguments[place])
                error = again.exception()
                is_lost = isinstance(error, Exception) and lost_worker(error)
                yield place, error if is_lost and isinstance(error, Exception) else again.result()
                progress.update()
        finally:
            for future in pending:
                future.cancel()
