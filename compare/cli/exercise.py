"""The exercise next to its optimum: `slamgauge exercise`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path

import tyro

from slamgauge.compare.cli.common import RootSeed, WithPage, Work, staged
from slamgauge.compare.exercise import results, tables
from slamgauge.compare.report import exercise_page
from slamgauge.compare.storage.result_files import EXERCISE


@dataclass
class Command(WithPage):
    """The settings of the exercise (TP4, ROB312), EKF and GTSAM batch on the same measurements, next to the optimum.

    After an interruption it continues; a larger --runs later adds the missing runs.

    For example:
      slamgauge exercise q1 --runs 20
      slamgauge exercise

    Attributes:
        questions: Questions, of q1, q2, q3, q4. All if none is given.
        runs: Number of independent runs of each setting.
        out: Folder of exercise.json, the figures, the pages and the stored runs.
    """

    questions: tyro.conf.Positional[tuple[str, ...]] = ()
    runs: int = 10
    seed: RootSeed = 0
    out: Path = Path("results/exercise")
    work: Work = field(default_factory=Work)

    def run(self) -> int:
        with self.work.executor() as executor:
            exercise, done = results.run_exercise(self.questions, self.runs, self.seed, self.out, executor), True
            with staged(self.out, EXERCISE) as folder:
                self.output.show(exercise.to_json(), tables.exercise_page(exercise), folder and folder / EXERCISE)
            if not self.page.no_report:
                exercise_page.publish_first_runs(exercise.settings, self.seed, self.out, executor)
                if done := exercise_page.publish_exercise(self.out, exercise):
                    self.page.show(self.out)
        print(f"written to {self.out}", file=sys.stderr)
        return 0 if done and not exercise.failures else 1
