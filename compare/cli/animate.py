"""A run as a moving picture: `slamgauge animate`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from slamgauge.compare.cli.common import PageOptions, split_names
from slamgauge.compare.cli.run import Command as Run
from slamgauge.compare.figures import animation
from slamgauge.compare.report import study_page
from slamgauge.compare.storage.result_files import METRICS, SUMMARY
from slamgauge.compare.studies import stored_study, study_run
from slamgauge.errors import UserError


@dataclass
class Command:
    """Draw a run as a moving picture: animation.gif.

    It shows the paths, robots and maps of the filtered estimates (of more than three, only the first) and the paths of
    the smoothed ones. For a study it repeats the worst run, in the folder worst-run, and draws that.

    For example:
      slamgauge animate first-run --estimators ekf,riekf --seconds 20 --fps 25

    Attributes:
        folder: Folder that `slamgauge run`, `evaluate --out` or `study` wrote. The animation is written there too.
        estimators: Comma-separated: estimators to show, as the command of the run named them. No code of yours is run.
        seconds: Duration.
        fps: Frames per second. More frames make a larger GIF.
    """

    folder: tyro.conf.Positional[Path]
    estimators: str = ""
    seconds: float = 10.0
    fps: int = 10

    def run(self) -> int:
        status, folder = 0, self.folder
        if (folder / SUMMARY).is_file() and not (folder / METRICS).is_file():
            folder = self.folder / "worst-run"
            status = self._repeat_worst_run(folder)
        animation.animate(folder, split_names(self.estimators), self.seconds, self.fps)
        print(f"written to {folder}: {animation.GIF}", file=sys.stderr)
        return status

    def _repeat_worst_run(self, out: Path) -> int:
        """Repeat the run of a study with the largest ATE of the first of `estimators`; return the exit status."""
        study, named = stored_study.load_study(self.folder), split_names(self.estimators)
        name = named[0] if named and named[0] in study.runs else next(iter(study.runs))
        worst = study_page.runs_to_look_at(study.runs[name])["worst"]
        if worst is None:
            raise UserError(f"{self.folder}: {name} has no run with a known error; name another in --estimators")
        run = int(study.runs[name].run[worst])
        print(f"run {run}, the worst of {name}:", file=sys.stderr)
        again, seed = study_page.request_of(study.summary), study_run.run_seed(study.summary.seed, run)
        settings, page = [tuple(study_page.settings_of(again))], PageOptions(no_report=True)
        return Run(seed, again.estimators, scenario=again.scenario, set=settings, out=out, page=page).run()
