"""`slamgauge report`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from slamgauge.compare.cli.options import Folder
from slamgauge.compare.cli.pages import Open, open_page
from slamgauge.compare.cli.run import Run
from slamgauge.compare.storage.result_files import REPORT


@dataclass
class Report:
    """Write report.html into a folder of results: one page that explains them, with a replay of a run.

    It opens from disk, in any current browser, without network.

    For example:
      slamgauge report first-run --open
      slamgauge report q1
    """

    what: tyro.conf.Positional[Folder]
    """What run, evaluate --out, study, study --sweep, budget, claims, grade or noise has written; or q1, q2, q3, q4: a
    question of the practical, which is carried out and explained on one page."""

    out: Folder | None = None
    """Of a question: the folder of its runs and its page; results/QUESTION if not given."""

    open: Open = False

    def __call__(self) -> int:
        """Write and, if asked to, open the page; the exit status."""
        from slamgauge.compare.report.exercise import QUESTIONS
        from slamgauge.compare.report.publishing import publish_question, publish_report

        name, folder, status = str(self.what), self.what, 0
        if name in QUESTIONS and (self.out or not folder.exists()):
            folder = self.out or Path("results") / name
            for each, estimators in QUESTIONS[name].runs.items():
                print(f"{each}:")
                status |= Run(each, estimators=estimators, out=folder / each)()
            publish_question(folder, name)
        else:
            publish_report(folder)
        print(f"written to {folder / REPORT}", file=sys.stderr)
        if self.open:
            open_page(folder)
        return status
