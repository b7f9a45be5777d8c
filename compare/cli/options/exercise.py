"""Options of `slamgauge exercise`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import tyro

from slamgauge.compare.cli.options.shared import Folder, RootSeed, WithPage, Work


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
