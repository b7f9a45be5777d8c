"""A folder of submissions: `slamgauge grade`."""

from __future__ import annotations

import secrets
import sys
from pathlib import Path

from slamgauge.compare.cli.options.user_filters import Grade
from slamgauge.compare.cli.steps import executor_of, finish, overridden_scenario, require_timeout, results_folder
from slamgauge.compare.estimators.requests import Limits, ask
from slamgauge.compare.estimators.sandbox import require_wall
from slamgauge.compare.grading.grade_output import grades_page, write_grades
from slamgauge.compare.grading.grading import grade_folder
from slamgauge.compare.grading.rubric import load_rubric
from slamgauge.compare.grading.submissions import submissions_in
from slamgauge.compare.grading.trial import GradeSettings
from slamgauge.compare.storage.result_files import GRADES
from slamgauge.compare.storage.safe_names import file_name
from slamgauge.errors import UserError


def run(command: Grade) -> int:
    """Run the command; return the exit status."""
    if not command.unconfined:
        require_wall()
    out = command.out or Path("results") / f"grades-{file_name(command.folder.resolve().name)}"
    scenario, (reference,) = overridden_scenario(command.scenario, command.set), ask([command.reference])
    submissions = submissions_in(command.folder)
    limits, rubric = Limits(require_timeout(command.timeout), not command.unconfined), load_rubric(command.rubric)
    with results_folder(out, GRADES) as staged:
        with executor_of(command.work) as executor:
            seed = secrets.randbits(32) if command.seed is None else command.seed
            settings = GradeSettings(scenario, command.runs, seed, reference, limits, rubric)
            grades = grade_folder(submissions, settings, executor)
        if not any(each.is_graded for each in grades.grades):
            first = grades.grades[0]
            raise UserError(f"{command.folder}: nothing could be graded; {first.submission}: {first.reasons[0]}")
        if command.seed is None:
            print(f"slamgauge: root seed {seed} (random; --seed {seed} grades on the same runs)", file=sys.stderr)
        command.output.show(grades.to_json(), grades_page(grades))
        if staged is not None:
            write_grades(staged, grades)
    done = all(each.is_graded for each in grades.grades)
    return finish(command, out, GRADES, done=done)
