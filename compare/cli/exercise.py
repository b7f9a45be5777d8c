"""The exercise next to its optimum: `slamgauge exercise`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from concurrent.futures import Executor

from slamgauge.compare.cli.options.exercise import Exercise
from slamgauge.compare.cli.steps import continued_later, executor_of, open_page
from slamgauge.compare.exercise import running
from slamgauge.compare.exercise.results import QuestionResult, exercise_json, results
from slamgauge.compare.exercise.running import run_exercise
from slamgauge.compare.exercise.tables import exercise_page
from slamgauge.compare.report.exercise_page import publish_exercise
from slamgauge.compare.report.exercise_runs import publish_first_runs
from slamgauge.compare.storage.files import write_json
from slamgauge.compare.storage.result_files import EXERCISE
from slamgauge.compare.storage.staged_folder import staged_folder


def run(command: Exercise) -> int:
    """Run the command; return the exit status."""
    with continued_later(), executor_of(command.work) as executor:
        exercise = run_exercise(command.questions, command.runs, command.seed, command.out, executor)
        found = results(exercise)
        content = exercise_json(exercise, found)
        command.output.show(content, exercise_page(found, command.runs, exercise.failures))
        with staged_folder(command.out, [EXERCISE], last=EXERCISE) as stage:
            write_json(stage / EXERCISE, content)
        done = command.page.no_report or _publish(command, exercise, found, executor)
    print(f"written to {command.out}", file=sys.stderr)
    return 0 if done and not exercise.failures else 1


def _publish(
    command: Exercise, exercise: running.Exercise, found: Sequence[QuestionResult], executor: Executor
) -> bool:
    """Write run 0 of each setting, figures and pages; return whether all succeeded."""
    ran = [each for settings in exercise.settings.values() for each in settings]
    publish_first_runs(ran, command.seed, command.out, executor)
    done = publish_exercise(command.out, exercise, found)
    if done and command.page.open:
        open_page(command.out)
    return done
