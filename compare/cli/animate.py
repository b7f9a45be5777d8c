"""A run as a moving picture: `slamgauge animate`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from slamgauge.compare.cli.options import Folder, PageOptions, split_names
from slamgauge.compare.cli.run import Run
from slamgauge.errors import UserError


@dataclass
class Animate:
    """Draw a run as a moving picture: animation.gif.

    It shows the paths, robots and maps of the filtered estimates (of more than three, only the first) and the paths of
    the smoothed ones. For a study it repeats the worst run, in the folder worst-run, and draws that.

    For example:
      slamgauge animate first-run --estimators ekf,riekf --seconds 20 --fps 25
    """

    folder: tyro.conf.Positional[Folder]
    """Folder that `slamgauge run`, `evaluate --out` or `study` wrote. The animation is written there too."""

    estimators: str = ""
    """Comma-separated: estimators to show, as the command of the run named them. No code of yours is run."""

    seconds: float = 10.0
    """Duration."""

    fps: int = 10
    """Frames per second. More frames make a larger GIF."""

    def __call__(self) -> int:
        from slamgauge.compare.figures.animation import GIF, animate
        from slamgauge.compare.storage.result_files import METRICS, SUMMARY

        status, folder = 0, self.folder
        if (folder / SUMMARY).is_file() and not (folder / METRICS).is_file():
            folder = self.folder / "worst-run"
            status = self._repeat_worst_run(folder)
        animate(folder, split_names(self.estimators), self.seconds, self.fps)
        print(f"written to {folder}: {GIF}", file=sys.stderr)
        return status

    def _repeat_worst_run(self, out: Path) -> int:
        """Repeat the run of a study with the largest ATE of the first of `estimators`; return the exit status."""
        from slamgauge.compare.report.study_page import request_of, runs_to_look_at, settings_of
        from slamgauge.compare.studies.stored_study import load_study
        from slamgauge.compare.studies.study_run import run_seed

        study, named = load_study(self.folder), split_names(self.estimators)
        name = named[0] if named and named[0] in study.runs else next(iter(study.runs))
        worst = runs_to_look_at(study.runs[name])["worst"]
        if worst is None:
            raise UserError(f"{self.folder}: {name} has no run with a known error; name another in --estimators")
        run = int(study.runs[name].run[worst])
        print(f"run {run}, the worst of {name}:", file=sys.stderr)
        again, seed = request_of(study.summary), run_seed(study.summary.seed, run)
        page = PageOptions(no_report=True)
        return Run(again.scenario, seed, again.estimators, set=[tuple(settings_of(again))], out=out, page=page)()
