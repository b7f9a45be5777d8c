"""Grade a folder of submissions on the same runs, each in its own process."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from slamgauge.compare.estimators.requests import Asked, Limits
from slamgauge.compare.estimators.running import require_room_for_runs
from slamgauge.compare.grading.grades import Grade, figure_remarks, grade
from slamgauge.compare.grading.rubric import Rubric
from slamgauge.compare.grading.submissions import Submission
from slamgauge.compare.grading.trial import Run, Trial, reference_run, run_trial
from slamgauge.compare.scenarios.scenario import Scenario, scenario_text
from slamgauge.compare.storage.progress import counted
from slamgauge.compare.storage.result_files import origin
from slamgauge.compare.studies.executors import lost_worker
from slamgauge.compare.studies.store import digest
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.errors import UserError, failure_text

T = TypeVar("T")

LOST = "the worker process that ran it died (out of memory?); make room and grade it again"


@dataclass(frozen=True)
class GradeSettings:
    """Settings of grading.

    Attributes:
        scenario: scenario of the simulated runs.
        runs: number of runs, at least 2.
        seed: root seed, a non-negative number.
        reference: estimator whose results submissions are compared with.
        limits: largest time of a run of a submission, and whether it runs behind a wall.
        rubric: weights of the points.
    """

    scenario: Scenario
    runs: int
    seed: int
    reference: Asked
    limits: Limits
    rubric: Rubric


@dataclass(frozen=True)
class Grades:
    """Grades of submissions.

    Attributes:
        folder: folder of the submissions.
        settings: scenario, runs, seed and reference.
        reference_grade: grade of the reference, compared with itself.
        grades: grades of the submissions, in the order of their names.
    """

    folder: Path
    settings: GradeSettings
    reference_grade: Grade
    grades: tuple[Grade, ...]

    @property
    def scenario_text(self) -> str:
        """The scenario as a TOML file."""
        return scenario_text(self.settings.scenario)

    def to_json(self) -> list[dict[str, Any]]:
        """Return a row for each submission, with scenario, seed and their digest."""
        scenario, seed = self.settings.scenario, self.settings.seed
        where = {"scenario": scenario.name, "seed": seed, "digest": digest(scenario, seed)}
        return [each.to_json() | where | origin(self.scenario_text) for each in self.grades]


def grade_folder(
    folder: Path, submissions: Sequence[Submission], settings: GradeSettings, executor: Executor
) -> Grades:
    """Grade submissions; an error or crash of one does not affect the others.

    Args:
        folder: folder of the submissions.
        submissions: `submissions_in` that folder.
        settings: runs, reference and largest time.
        executor: runs submissions, one at a time on each of its workers.

    Raises:
        UserError: settings are out of range, or the reference fails.
    """
    scenario, runs, seed, reference = settings.scenario, settings.runs, settings.seed, settings.reference
    if runs < 2:
        raise UserError(f"runs: {runs} has no interval, so nothing can be judged; give at least 2")
    if seed < 0:
        raise UserError(f"seed: {seed} is negative; use a whole number >= 0")
    require_room_for_runs(runs, scenario, 1)
    seeds = [run_seed(seed, run) for run in range(runs)]
    arguments = [(scenario, each, reference) for each in seeds]
    measured = dict(_results(executor, reference_run, arguments, "run"))
    references: list[Run] = []
    for run in range(runs):
        done = measured[run]
        if isinstance(done, Exception):
            raise UserError(f"reference {reference.label}: {done}")
        references.append(done)
    scores, rubric = [each.score for each in references], settings.rubric
    arguments = [(each, settings, references) for each in submissions]
    found = dict(_results(executor, _graded, arguments, "submission"))
    grades = [
        done if isinstance(done := found[place], Grade) else grade(each.name, Trial(reason=LOST), scores, rubric)
        for place, each in enumerate(submissions)
    ]
    own = f"({reference.label})"
    same = figure_remarks({each.submission: each.trial.scores for each in grades} | {own: scores}, own)
    marked = [replace(each, remarks=tuple(same.get(each.submission, ()))) for each in grades]
    return Grades(folder, settings, grade(reference.label, Trial(scores=scores), scores, rubric), tuple(marked))


def _graded(submission: Submission, settings: GradeSettings, runs: Sequence[Run]) -> Grade:
    """Run and grade a submission.

    Any error is its reason, so that the others have their grades. Only this function and `main` catch all errors.
    """
    name, where, scores = submission.name, submission.where, [each.score for each in runs]
    try:
        if where is None:
            return grade(name, Trial(reason=submission.reason), scores, settings.rubric)
        trial = run_trial(where, name, settings.scenario, runs, settings.limits, settings.rubric.needed_checks)
        return grade(name, trial, scores, settings.rubric)
    except Exception as error:  # noqa: BLE001 see above
        return grade(name, Trial(reason=failure_text(error)), scores, settings.rubric)


def _results(
    executor: Executor, work: Callable[..., T], arguments: Sequence[tuple[Any, ...]], unit: str
) -> Generator[tuple[int, T | Exception]]:
    """Call `work` with each of the arguments; yield number and result as they arrive.

    If a worker dies, all calls of its pool are lost; these are repeated one by one, and a call that fails again yields
    its exception.
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
                repeated = executor.submit(work, *arguments[place])
                error = repeated.exception()
                yield place, error if isinstance(error, Exception) and lost_worker(error) else repeated.result()
                progress.update()
        finally:
            for future in pending:
                future.cancel()
