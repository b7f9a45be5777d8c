"""A folder of submissions: `slamgauge grade`."""

from __future__ import annotations

import secrets
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from slamgauge.compare.cli import common
from slamgauge.compare.estimators import requests, sandbox
from slamgauge.compare.grading import grade_output, grading, rubric, submissions, trial
from slamgauge.compare.scenarios import scenario as scenarios
from slamgauge.compare.storage import staged_folder
from slamgauge.compare.storage.result_files import GRADES
from slamgauge.errors import UserError


@dataclass
class Command(common.WithPage):
    """Grade a folder of submissions against a reference filter. Each runs in a separate process without the truth.

    Exit status 1 if a submission could not be graded; the other grades are kept.

    For example:
      slamgauge grade submissions --scenario q1-long-dense --runs 20

    Attributes:
        folder: Folder of the submissions: Python files and folders (docs/grading.md). THIS LOADS AND RUNS THAT CODE.
        runs: Number of runs.
        seed: Root seed. The seed of each run is spawned from it. Anyone who knows it can compute the truth. If not
            given: a random one, which is printed and stored.
        rubric: TOML file with the weights of the points (docs/grading.md). If not given: the rubric of slamgauge.
        reference: Submissions must not be significantly worse than this: a built-in name or [LABEL=]FILE.py:callable.
        timeout: Seconds that a submission may take for a run.
        out: Folder of grades.csv, submissions/NAME.html and gradescope/NAME/results.json. If not given:
            results/grades-FOLDER.
    """

    folder: tyro.conf.Positional[Path]
    scenario: Annotated[str, tyro.conf.arg(help=f"{common.NAMED}. Each run draws its true start from the prior.")]
    runs: int = 20
    seed: int | None = None
    set: common.Overrides = field(default_factory=list)
    rubric: Path | None = None
    reference: str = "ekf"
    timeout: float = 60.0
    unconfined: common.Unconfined = False
    work: common.Work = field(default_factory=common.Work)
    out: Path | None = None

    def run(self) -> int:
        if not self.unconfined:
            sandbox.require_wall()
        out = self.out or common.results_of("grades", self.folder)
        scenario = scenarios.load_scenario(self.scenario, common.flattened(self.set))
        (reference,) = requests.ask([self.reference])
        found = submissions.submissions_in(self.folder)
        limits = requests.Limits(common.require_timeout(self.timeout), not self.unconfined)
        weights = rubric.load_rubric(self.rubric)
        with staged_folder.staged_folder(out, GRADES) as stage:
            with self.work.executor() as executor:
                seed = secrets.randbits(32) if self.seed is None else self.seed
                settings = trial.GradeSettings(scenario, self.runs, seed, reference, limits, weights)
                grades = grading.grade_folder(found, settings, executor)
            if not any(each.is_graded for each in grades.grades):
                first = grades.grades[0]
                raise UserError(f"{self.folder}: nothing could be graded; {first.submission}: {first.reasons[0]}")
            if self.seed is None:
                print(f"slamgauge: root seed {seed} (random; --seed {seed} grades on the same runs)", file=sys.stderr)
            self.output.show(grades.to_json(), grade_output.grades_page(grades))
            grade_output.write_grades(stage, grades)
        return self.finish(out, GRADES, done=all(each.is_graded for each in grades.grades))
