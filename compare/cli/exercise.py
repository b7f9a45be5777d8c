"""The exercise next to its optimum: `slamgauge exercise`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from slamgauge.compare.cli.options import Folder, RootSeed, WithPage, Work, open_page
from slamgauge.compare.cli.study import continued_later
from slamgauge.compare.storage.result_files import EXERCISE

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from slamgauge.compare.exercise.results import Exercise


@dataclass
class ExerciseCommand(WithPage):
    """The settings of the exercise (TP4, ROB312), EKF and GTSAM batch on the same measurements, next to the optimum.

    After an interruption it continues; a larger --runs later adds the missing runs.

    For example:
      slamgauge exercise q1 --runs 20
      slamgauge exercise
    """

    questions: tyro.conf.Positional[tuple[str, ...]] = ()
    """Questions, of q1, q2, q3, q4. All if none is given."""

    runs: int = 10
    """Number of independent runs of each setting."""

    seed: RootSeed = 0

    out: Folder = Path("results/exercise")
    """Folder of exercise.json, the figures, the pages and the stored runs."""

    work: Work = field(default_factory=Work)

    def __call__(self) -> int:
        from slamgauge.compare.exercise.running import run_exercise
        from slamgauge.compare.exercise.tables import exercise_page
        from slamgauge.compare.storage.files import write_json
        from slamgauge.compare.storage.staged_folder import staged_folder

        with continued_later(), self.work.executor() as executor:
            exercise = run_exercise(self.questions, self.runs, self.seed, self.out, executor)
            content = exercise.to_json()
            self.output.show(content, exercise_page(exercise))
            with staged_folder(self.out, [EXERCISE], last=EXERCISE) as stage:
                write_json(stage / EXERCISE, content)
            done = self.page.no_report or self._publish(exercise, executor)
        print(f"written to {self.out}", file=sys.stderr)
        return 0 if done and not exercise.failures else 1

    def _publish(self, exercise: Exercise, executor: Executor) -> bool:
        """Write run 0 of each setting, figures and pages; return whether all succeeded."""
        from slamgauge.compare.report.exercise_page import publish_exercise
        from slamgauge.compare.report.exercise_runs import publish_first_runs

        publish_first_runs(exercise.settings, self.seed, self.out, executor)
        done = publish_exercise(self.out, exercise)
        if done and self.page.open:
            open_page(self.out)
        return done
