"""Options of `slamgauge check` and `grade`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import tyro

from slamgauge.compare.cli.options.shared import NAMED, Folder, Options, Overrides, Unconfined, WithPage, Work
from slamgauge.compare.cli.terminal import Output


@dataclass
class Check(Options):
    """Test an estimator with checks that every right filter passes. A failed check names the part that is wrong.

    Exit status 1 if a check fails. A limit of the textbook method is reported, but does not count as a failure.

    For example:
      slamgauge check my_filter.py:estimate
    """

    estimator: tyro.conf.Positional[str]
    """A built-in name, or your own: [LABEL=]FILE.py or [LABEL=]FILE.py:callable. THIS LOADS AND RUNS THAT CODE."""

    seed: int = 0
    """Seed of the random recordings of the checks."""

    timeout: float = 60.0
    """Seconds that a check of your own code may take. If it takes longer, it fails and the others are not run."""

    output: Output = field(default_factory=Output)


@dataclass
class Grade(WithPage):
    """Grade a folder of submissions against a reference filter. Each runs in a separate process without the truth.

    Exit status 1 if a submission could not be graded; the other grades are kept.

    For example:
      slamgauge grade submissions --scenario q1-long-dense --runs 20
    """

    folder: tyro.conf.Positional[Folder]
    """Folder of the submissions: Python files and folders (docs/grading.md). THIS LOADS AND RUNS THAT CODE."""

    scenario: Annotated[str, tyro.conf.arg(help=f"{NAMED}. Each run draws its true start from the prior.")]

    runs: int = 20
    """Number of runs."""

    seed: int | None = None
    """Root seed. The seed of each run is spawned from it. Anyone who knows it can compute the truth. If not given: a
    random one, which is printed and stored."""

    set: Overrides = field(default_factory=list)

    rubric: Folder | None = None
    """TOML file with the weights of the points (docs/grading.md). If not given: the rubric of slamgauge."""

    reference: str = "ekf"
    """Submissions must not be significantly worse than this: a built-in name or [LABEL=]FILE.py:callable."""

    timeout: float = 60.0
    """Seconds that a submission may take for a run."""

    unconfined: Unconfined = False

    work: Work = field(default_factory=Work)

    out: Folder | None = None
    """Folder of grades.csv, submissions/NAME.html and gradescope/NAME/results.json. If not given:
    results/grades-FOLDER."""
