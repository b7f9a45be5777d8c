"""User filters: `slamgauge check` (properties of one) and `grade` (a folder of submissions)."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from slamgauge.compare.cli.options import (
    NAMED,
    Folder,
    Form,
    Overrides,
    Unconfined,
    WithPage,
    Work,
    overridden_scenario,
    require_scenario,
    require_timeout,
    results_folder,
)
from slamgauge.compare.cli.terminal import Output
from slamgauge.errors import UserError


@dataclass
class Check:
    """Test an estimator with checks that every right filter passes. A failed check names the part that is wrong.

    Exit status 1 if a check fails. A limit of the textbook method is reported, but does not count as a failure.

    For example:
      slamgauge check my_filter.py:estimate
    """

    estimator: tyro.conf.Positional[str]
    """A built-in name, or your own: [LABEL=]FILE.py or [LABEL=]FILE.py:callable. THIS LOADS AND RUNS THAT CODE."""

    form: Form = ""

    seed: int = 0
    """Seed of the random recordings of the checks."""

    timeout: float = 60.0
    """Seconds that a check of your own code may take. If it takes longer, it fails and the others are not run."""

    unconfined: Unconfined = False

    output: Output = field(default_factory=Output)

    def __call__(self) -> int:
        from slamgauge.compare.checks.examination import check_estimator, verdicts_json, verdicts_table
        from slamgauge.compare.estimators.isolated_process import can_isolate
        from slamgauge.compare.estimators.loading import load
        from slamgauge.compare.estimators.requests import Isolation, ask, isolated, with_noise_and_form

        if self.seed < 0:
            raise UserError(f"seed {self.seed}: a seed must not be negative; give one >= 0")
        # not strict: the check `no-future` compares estimates of beginnings
        isolation = Isolation(require_timeout(self.timeout), strict=False, unconfined=self.unconfined)
        requested = with_noise_and_form(ask([self.estimator]), "recording", self.form)
        (asked,) = isolated(requested, isolation if can_isolate() else None)
        verdicts = check_estimator(asked.label, load(asked), self.seed)
        self.output.show(verdicts_json(verdicts), verdicts_table(verdicts))
        return 0 if not any(verdict.is_failure for verdict in verdicts) else 1


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

    form: Form = ""

    work: Work = field(default_factory=Work)

    out: Folder | None = None
    """Folder of grades.csv, submissions/NAME.md and gradescope/NAME/results.json. If not given:
    results/grades-FOLDER."""

    def __call__(self) -> int:
        require_scenario(self.scenario)
        import secrets  # here: it is slow to start

        from slamgauge.compare.estimators.isolated_process import require_isolation
        from slamgauge.compare.estimators.requests import Isolation, ask
        from slamgauge.compare.grading.grade_output import grade_table, write_grades, write_pages
        from slamgauge.compare.grading.grading import GradeSettings, grade_folder
        from slamgauge.compare.grading.rubric import load_rubric
        from slamgauge.compare.grading.submissions import submissions_in
        from slamgauge.compare.storage.result_files import GRADES, GRADESCOPE, PAGES, RESULTS, grade_files
        from slamgauge.compare.storage.safe_names import file_name

        require_isolation("grade on Linux or macOS", unconfined=self.unconfined)
        out = self.out or Path("results") / f"grades-{file_name(self.folder.resolve().name)}"
        scenario, (reference,) = overridden_scenario(self.scenario, self.set), ask([self.reference])
        submissions = submissions_in(self.folder)
        isolation = Isolation(require_timeout(self.timeout), strict=False, unconfined=self.unconfined)
        rubric, submissions = load_rubric(self.rubric), [each.of_form(self.form) for each in submissions]
        writes = grade_files(each.name for each in submissions)
        outdated = [f"{PAGES}/*.md", f"{PAGES}/*.html", f"{GRADESCOPE}/*/{RESULTS}", RESULTS]
        with results_folder(out, writes, GRADES, outdated) as staged:
            with self.work.executor() as executor:
                seed = secrets.randbits(32) if self.seed is None else self.seed
                settings = GradeSettings(scenario, self.runs, seed, reference, isolation, rubric)
                grades = grade_folder(self.folder, submissions, settings, executor)
            if not any(each.is_graded for each in grades.grades):
                first = grades.grades[0]
                raise UserError(f"{self.folder}: nothing could be graded; {first.submission}: {first.reasons[0]}")
            if self.seed is None:
                print(f"slamgauge: root seed {seed} (random; --seed {seed} grades on the same runs)", file=sys.stderr)
            self.output.show(grades.to_json(), grade_table(grades))
            if staged is not None:
                write_grades(staged, grades)
        done = write_pages(out, grades) and all(each.is_graded for each in grades.grades)
        return self.finish(out, GRADES, done=done)
