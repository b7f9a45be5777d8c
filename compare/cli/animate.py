"""Draw a run as a moving picture: `slamgauge animate`."""

from __future__ import annotations

import sys
from pathlib import Path

from slamgauge.compare.cli.options.animate import Animate
from slamgauge.compare.cli.options.run import Run
from slamgauge.compare.cli.options.shared import PageOptions, split_names
from slamgauge.compare.cli.run import run as run_once
from slamgauge.compare.figures.frames import GIF, animate
from slamgauge.compare.report.study_pages import request_of, runs_to_look_at
from slamgauge.compare.storage.result_files import METRICS, SUMMARY
from slamgauge.compare.studies.stored_study import load_study
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.errors import UserError


def run(command: Animate) -> int:
    """Run the command; return the exit status."""
    status, folder = 0, command.folder
    if (folder / SUMMARY).is_file() and not (folder / METRICS).is_file():
        folder = command.folder / "worst-run"
        status = _repeat_worst_run(command, folder)
    animate(folder, split_names(command.estimators), command.seconds, command.fps)
    print(f"written to {folder}: {GIF}", file=sys.stderr)
    return status


def _repeat_worst_run(command: Animate, out: Path) -> int:
    """Repeat the run of a study with the largest ATE of the first of `estimators`; return the exit status."""
    study, named = load_study(command.folder), split_names(command.estimators)
    name = named[0] if named and named[0] in study.runs else next(iter(study.runs))
    worst = runs_to_look_at(study.runs[name]).get("worst")
    if worst is None:
        raise UserError(f"{command.folder}: {name} has no run with a known error; name another in --estimators")
    run = int(study.runs[name].run[worst])
    print(f"run {run}, the worst of {name}:", file=sys.stderr)
    again, seed = request_of(study.summary), run_seed(study.summary.seed, run)
    page = PageOptions(no_report=True)
    return run_once(Run(seed, again.estimators, scenario=again.scenario, set=[again.settings], out=out, page=page))
