"""`slamgauge grade`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path

import tyro

from slamgauge.compare.cli.options import (
    Folder,
    Work,
    carried_by,
    print_result,
    require_timeout,
    results_folder,
    sampled_scenario,
)
from slamgauge.compare.cli.pages import PageOptions, write_page
from slamgauge.compare.cli.terminal import Output
from slamgauge.errors import UserError


@dataclass
class Grade:
    """Grade a folder of submissions, each in a process of its own and without the truth, against a reference filter.

    Exit status 1 if one could not be graded; the others are.

    For example:
      slamgauge grade submissions --scenario q1-long-dense --runs 20
    """

    folder: tyro.conf.Positional[Folder]
    """Python files, and folders with them: one submission each, in any form that slamgauge knows
    (docs/your_filter.md). LOADS AND RUNS THAT CODE."""

    scenario: str
    """A shipped name (`slamgauge scenarios` lists them) or the path of a TOML file; the true start is drawn
    from the prior."""

    runs: int = 20
    """How many runs."""

    seed: int = 0
    """Root seed, from which the runs' own seeds are spawned. Whoever knows it can make the truth: give one that
    nobody knows."""

    reference: str = "ekf"
    """The filter that a submission may not be shown to be worse than: one of ours, or [LABEL=]FILE.py:callable."""

    timeout: float = 60.0
    """Seconds that a submission may take for a run."""

    work: Work = field(default_factory=Work)

    out: Folder | None = None
    """Folder of grades.csv, grades.xml (JUnit) and submissions/NAME.md; results/grades-FOLDER if not given."""

    page: PageOptions = field(default_factory=PageOptions)

    output: Output = field(default_factory=Output)

    def __call__(self) -> int:
        """Run, judge, print and write; the exit status."""
        from slamgauge.compare.estimators.isolated_process import require_isolation
        from slamgauge.compare.estimators.requests import ask
        from slamgauge.compare.grading.grade_output import grade_table, write_grades, write_pages
        from slamgauge.compare.grading.grading import GradeSettings, grade_folder
        from slamgauge.compare.grading.submissions import submissions_in
        from slamgauge.compare.storage.result_files import GRADES, PAGES, grade_files
        from slamgauge.compare.storage.safe_names import file_name

        require_isolation("grade on Linux or macOS")
        out = self.out or Path("results") / f"grades-{file_name(self.folder.resolve().name)}"
        scenario, (reference,) = sampled_scenario(self.scenario, []), ask([self.reference])
        submissions, timeout = submissions_in(self.folder), require_timeout(self.timeout)
        writes = grade_files(each.name for each in submissions)
        with results_folder(out, writes, GRADES, [f"{PAGES}/*.md", f"{PAGES}/*.html"]) as staged:
            with carried_by(self.work.jobs) as executor:
                settings = GradeSettings(scenario, self.runs, self.seed, reference, timeout)
                grades = grade_folder(self.folder, submissions, settings, executor)
            if not any(each.is_graded for each in grades.grades):
                first = grades.grades[0]
                raise UserError(f"{self.folder}: nothing could be graded; {first.submission}: {first.reasons[0]}")
            printed = print_result(grades.to_json() if self.output.json else grade_table(grades))
            if staged is not None:
                write_grades(staged, grades)
        told = write_pages(out, grades)
        print(f"written to {out}", file=sys.stderr)
        explained = write_page(out, GRADES, self.page)
        return 0 if printed and told and explained and all(each.is_graded for each in grades.grades) else 1
