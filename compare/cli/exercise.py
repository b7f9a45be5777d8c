"""The exercise next to its optimum: `slamgauge exercise`."""

from __future__ import annotations

import sys
from concurrent.futures import Executor

from slamgauge.compare.cli.options.exercise import ExerciseCommand
from slamgauge.compare.cli.steps import continued_later, executor_of, open_page
from slamgauge.compare.exercise.results import Exercise, run_exercise
from slamgauge.compare.exercise.tables import exercise_page
from slamgauge.compare.report.exercise_page import publish_exercise, publish_first_runs
from slamgauge.compare.storage.files import write_json
from slamgauge.compare.storage.result_files import EXERCISE
from slamgauge.compare.storage.staged_folder import staged_folder


def run(command: ExerciseCommand) -> int:
    """Run the command; return the exit status."""
    with continued_later(), executor_of(command.work) as executor:
        exercise = run_exercise(command.questions, command.runs, command.seed, command.out, executor)
        content = exercise.to_json()
        command.output.show(content, exercise_page(exercise))
        with staged_folder(command.out, EXERCISE) as stage:
            write_json(stage / EXERCISE, content)
        done = command.page.no_report or _publish(command, exercise, executor)
    print(f"written to {command.out}", file=sys.stderr)
    return 0 if done and not exercise.failures else 1


def _publish(command: ExerciseCommand, exercise: Exercise, executor: Executor) -> bool:
    """Write run 0 of each setting, figures and pages; return whether all succeeded."""
    publish_first_runs(exercise.settings, command.seed, command.out, executor)
    done = publish_exercise(command.out, exercise)
    if done and command.page.open:
        open_page(command.out)
    return done
