"""`slamgauge animate`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from slamgauge.compare.cli.options import Folder, split_names
from slamgauge.errors import UserError


@dataclass
class Animate:
    """Show a run as a moving picture: animation.gif, and animation.mp4 where ffmpeg is installed.

    Of a study its worst run: it is carried out again, with the study's estimators, in the folder worst-run of it.

    For example:
      slamgauge animate first-run --estimators ekf,riekf --seconds 20 --fps 25
      slamgauge animate first-run --format strip
    """

    folder: tyro.conf.Positional[Folder]
    """What `slamgauge run`, `evaluate --out` or `study` has written; the animation goes there too."""

    estimators: str = ""
    """Comma-separated, as that command was given them: whose paths, robots and maps to show; if not given those of all
    filtered estimates (of more than three, of the first), and the paths of the smoothed ones. Nobody's code is run."""

    seconds: float = 10.0
    """How long it lasts."""

    fps: int = 10
    """Frames per second; a GIF grows with them."""

    format: Literal["usual", "gif", "mp4", "webm", "strip"] = "usual"
    """usual: gif, and mp4 where there is ffmpeg. strip: six moments side by side for print, animation.png and .svg."""

    def __call__(self) -> int:
        """Draw and write; the exit status."""
        from slamgauge.compare.figures.animation import animate, files_of
        from slamgauge.compare.storage.result_files import METRICS, SUMMARY

        status, folder = 0, self.folder
        if (folder / SUMMARY).is_file() and not (folder / METRICS).is_file():
            folder = self.folder / "worst-run"
            status = self._run_the_worst(folder)
        missing = animate(folder, split_names(self.estimators), self.seconds, self.fps, self.format)
        written = [name for name in files_of(self.format) if not (missing and name.endswith(".mp4"))]
        print(f"written to {folder}: {', '.join(written)}", file=sys.stderr)
        if missing:
            print(f"animation.mp4 is left out: {missing}", file=sys.stderr)
        return status

    def _run_the_worst(self, out: Path) -> int:
        """Carry out the run of a study in which the first estimator that is to be shown has its largest ATE."""
        from slamgauge.compare.cli.pages import PageOptions
        from slamgauge.compare.cli.run import Run
        from slamgauge.compare.report.rerun_command import run_of_study
        from slamgauge.compare.report.study_page import runs_to_look_at
        from slamgauge.compare.studies.stored_study import load_study
        from slamgauge.compare.studies.study_run import run_seed

        study, named = load_study(self.folder), split_names(self.estimators)
        name = named[0] if named and named[0] in study.runs else next(iter(study.runs))
        worst = runs_to_look_at(study.runs[name])["worst"]
        if worst is None:
            raise UserError(f"{self.folder}: {name} has no run with a known error; name another of --estimators")
        run = int(study.runs[name].run[worst])
        print(f"run {run}, the worst of {name}:", file=sys.stderr)
        again, seed = run_of_study(study.content), run_seed(study.summary.seed, run)
        settings = [tuple(again.settings)]
        return Run(again.scenario, seed, again.estimators, set=settings, out=out, page=PageOptions(no_report=True))()
