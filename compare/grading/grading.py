"""Grade a folder of submissions on the same runs, each in its own process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from slamgauge.compare.estimators.running import require_room_for_runs
from slamgauge.compare.grading.grades import Grade, figure_remarks, grade
from slamgauge.compare.grading.submissions import Submission
from slamgauge.compare.grading.trial import GradeSettings, Run, Trial, reference_run, run_trial
from slamgauge.compare.scenarios.scenario import scenario_text
from slamgauge.compare.storage.progress import counted
from slamgauge.compare.storage.result_files import origin
from slamgauge.compare.studies.executors import first_done, lost_worker
from slamgauge.compare.studies.store import digest
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.errors import UserError, failure_text

T = TypeVar("T")

LOST = "the worker process that ran it died (out of memory?); make room and grade it again"


@dataclass(frozen=True)
class Grades:
    """Grades of submissions."""

    settings: GradeSettings
    reference: Grade  # compared with itself
    grades: tuple[Grade, ...]  # in the order of the names of the submissions

    def to_json(self) -> list[dict[str, Any]]:
        """Return a row for each submission, with scenario, seed and their digest."""
        scenario, seed = self.settings.scenario, self.settings.seed
        where = {"scenario": scenario.name, "seed": seed, "digest": digest(scenario, seed)}
        return [each.to_json() | where | origin(scenario_text(scenario)) for each in self.grades]


def grade_folder(submissions: Sequence[Submission], settings: GradeSettings, executor: Executor) -> Grades:
    """Grade submissions; an error or crash of one does not affect the others.

    Args:
        submissions: `submissions_in` a folder.
        settings: runs, reference and largest time.
        executor: runs submissions, one at a time on each of its workers.

    Raises:
        UserError: settings are out of range, or the reference fails.
    """
    scenario, runs, seed, asked = settings.scenario, settings.runs, settings.seed, settings.reference
    if runs < 2:
        raise UserError(f"runs: {runs} has no interval, so nothing can be judged; give at least 2")
    if seed < 0:
        raise UserError(f"seed: {seed} is negative; use a whole number >= 0")
    require_room_for_runs(runs, scenario, 1)
    references: list[Run] = []
    for done in _results(
        executor, reference_run, [(scenario, run_seed(seed, run), asked) for run in range(runs)], "run"
    ):
        if isinstance(done, BaseException):
            raise UserError(f"reference {asked.label}: {done}")
        references.append(done)
    scores, rubric = [each.score for each in references], settings.rubric
    found = _results(executor, _graded, [(each, settings, references) for each in submissions], "submission")
    grades = [
        done if isinstance(done, Grade) else grade(each.name, Trial(reason=LOST), scores, rubric)
        for each, done in zip(submissions, found, strict=True)
    ]
    own = f"({asked.label})"
    same = figure_remarks({each.submission: each.trial.scores for each in grades} | {own: scores}, own)
    marked = [replace(each, remarks=tuple(same.get(each.submission, ()))) for each in grades]
    return Grades(settings, grade(asked.label, Trial(scores=scores), scores, rubric), tuple(marked))


def _graded(submission: Submission, settings: GradeSettings, runs: Sequence[Run]) -> Grade:
    """Run and grade a submission.

    Any error is its reason, so that the others have their grades. Only this function and `main` catch all errors.
    """
    name, where, scores = submission.name, submission.where, [each.score for each in runs]
    try:
        trial = Trial(reason=submission.reason)
        if where is not None:
            trial = run_trial(where, name, settings, runs)
        return grade(name, trial, scores, settings.rubric)
    except Exception as error:  # noqa: BLE001 see above
        return grade(name, Trial(reason=failure_text(error)), scores, settings.rubric)


def _results(
    executor: Executor, work: Callable[..., T], arguments: Sequence[tuple[Any, ...]], unit: str
) -> list[T | BaseException]:
    """Call `work` with each of the arguments; return its results.

    Calls whose workers have died are repeated one by one, and a call that fails again has its exception as result.
    Other errors of `work` are raised as soon as they occur.
    """
    futures = [executor.submit(work, *each) for each in arguments]
    pending = {*futures}
    with counted(len(futures), unit) as progress:
        try:
            while pending:
                done = first_done(pending)
                pending -= done
                for future in done:
                    if not lost_worker(future.exception()):
                        future.result()
                        progress.update()
        finally:
            for future in futures:
                future.cancel()
        for place, future in enumerate(futures):
            if lost_worker(future.exception()):
                futures[place] = executor.submit(work, *arguments[place])
                first_done([futures[place]])
                progress.update()
    return [future.exception() or future.result() for future in futures]
