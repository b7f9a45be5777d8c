"""Recordings, estimates, tables and figures for other programs: `slamgauge export FORMAT`, a subcommand for each."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import tyro

from slamgauge.compare.cli.common import results_of, split_names
from slamgauge.compare.cli.terminal import put
from slamgauge.compare.datasets import g2o_writer, imported_log
from slamgauge.compare.figures import plot_style, publishing
from slamgauge.compare.storage import csv_folder, files, staged_folder, trajectories
from slamgauge.compare.storage.result_files import METRICS, RECORDING, SUMMARY, TRUTH
from slamgauge.compare.studies import stored_study
from slamgauge.errors import UserError


@dataclass
class Format:
    """A format, with its options.

    Attributes:
        path: What is exported, described above.
        out: The file or folder that is written. If not given: results/export-NAME, with the ending of the format.
    """

    path: tyro.conf.Positional[Path]
    out: Path | None = None

    def write_file(self, ending: str, write: Callable[[Path], object], *beside: str) -> int:
        """Write one file; `beside` are names of files that `write` may write next to it."""
        out = self.out or Path(f"{results_of('export', self.path)}{ending}")
        with staged_folder.staged_files(out.parent, (out.name, *beside)) as folder, imported_log.of_file(self.path):
            write(folder / out.name)
        print(f"written to {out}", file=sys.stderr)
        return 0

    def write_folder(self, main: str, write: Callable[[Path], object]) -> int:
        """Write a folder of results with the main file `main`."""
        out = self.out or results_of("export", self.path)
        with staged_folder.staged_folder(out, main) as folder, imported_log.of_file(self.path):
            write(folder)
        print(f"written to {out}", file=sys.stderr)
        return 0


@dataclass
class StudyTable(Format):
    """The table of a study: its means with 95 % intervals. Without --out it is printed on standard output.

    Attributes:
        columns: Comma-separated keys of summary.json that have an interval. If not given: its key columns.
        estimators: Comma-separated. If not given: all.
        means_only: Leave out the intervals.
    """

    form: ClassVar[Literal["csv", "latex", "markdown"]] = "csv"
    columns: str = ""
    estimators: str = ""
    means_only: bool = False

    def run(self) -> int:
        columns, names = split_names(self.columns), split_names(self.estimators)
        text = stored_study.study_table(self.path, self.form, columns, names, intervals=not self.means_only)
        if self.out is not None:
            return self.write_file("", lambda out: out.write_text(text, encoding="utf-8"))
        put(text.rstrip("\n"))
        return 0


@dataclass
class Csv(StudyTable):
    """A recording as three files in a folder, the path and map of an estimate, or the table of a study.

    PATH is a recording.npz, an estimate of a run (FOLDER/estimates/NAME.npz), or the folder of a run or a study. A
    folder of a run stands for its recording. docs/your_filter.md describes the files.
    """

    def run(self) -> int:
        if (self.path / SUMMARY).exists() or self.columns or self.estimators or self.means_only:
            return super().run()
        recording, _, estimates = _load(self.path)
        if recording is not None:
            return self.write_folder(csv_folder.START, lambda out: csv_folder.write_recording_csv(out, recording))
        (estimate,) = estimates.values()
        return self.write_file(".csv", lambda out: csv_folder.write_estimate_csv(out, estimate), csv_folder.LANDMARKS)


@dataclass
class G2o(Format):
    """A recording as a graph. PATH is a recording.npz, or the folder of a run or an import.

    Attributes:
        lend: Standard deviation [m, rad] of regularising noise for motions whose covariance is singular.
    """

    lend: float | None = None

    def run(self) -> int:
        if self.lend is not None and not 0.0 < self.lend < 1.0:
            raise UserError(f"lend: {self.lend:g} is not a small standard deviation; give one between 0 and 1")
        recording, _, _ = _load(self.path)
        if recording is None:
            raise UserError(f"{self.path}: it is an estimate, not a recording; give recording.npz, or another format")
        return self.write_file(".g2o", lambda out: g2o_writer.write_g2o(out, recording, lend=self.lend))


@dataclass
class Mat(Format):
    """Everything, for Octave and MATLAB. PATH is a recording, an estimate, or the folder of a run."""

    def run(self) -> int:
        recording, truth, estimates = _load(self.path)
        records = {"recording": recording, "truth": truth, **estimates}
        found = {name: record for name, record in records.items() if record is not None}
        return self.write_file(".mat", lambda out: files.write_mat(out, found))


@dataclass
class Tum(Format):
    """Poses of an estimate: lines `t x y z qx qy qz qw`, then the upper triangle of the covariance, if it has one.

    Attributes:
        recording: The recording with the time stamps. If not given: the recording of its run.
    """

    recording: Path | None = None

    def run(self) -> int:
        estimates = _load(self.path)[2]
        if len(estimates) != 1:
            raise UserError(f"{self.path}: it has {len(estimates)} estimates; give FOLDER/estimates/NAME.npz")
        (estimate,) = estimates.values()
        folder = self.path if self.path.is_dir() else self.path.parent.parent
        path = self.recording or folder / RECORDING
        stamps, poses = files.load_recording(path).stamps, estimate.poses
        if len(stamps) != len(poses):
            what = f"{self.path}: it has {len(poses)} poses, but {path} has {len(stamps)}"
            raise UserError(f"{what}; give the recording of its run with --recording")
        return self.write_file(".tum", lambda out: trajectories.write_tum(out, stamps, poses, estimate.pose_covs))


@dataclass
class Latex(StudyTable):
    """The table of a study for LaTeX, with booktabs and a caption. Without --out it is printed on standard output."""

    form = "latex"


@dataclass
class Markdown(StudyTable):
    """The table of a study for Markdown. Without --out it is printed on standard output."""

    form = "markdown"


@dataclass
class Figures(Format):
    """The figures of a run, a study, a sweep, an error budget, noise or bench, redrawn for a paper, in a folder.

    Attributes:
        form: Format of the pictures.
        width: column is 3.4 in (one of two columns), page is 7.0 in.
        estimators: Comma-separated. If not given: all. In the figure of a run the 3-sigma bounds of the first are
            filled.
    """

    form: Literal["pdf", "png", "svg"] = "pdf"
    width: Literal["column", "page"] = "page"
    estimators: str = ""

    def run(self) -> int:
        drawings = publishing.drawings_of(self.path, split_names(self.estimators))
        with plot_style.printed_on(plot_style.Sheet(self.width, (self.form,))):
            main = f"{next(iter(drawings))}.{self.form}"
            return self.write_folder(main, lambda out: [draw(out) for draw in drawings.values()])


@dataclass
class Command:
    """Write recordings, estimates, tables of studies and figures in a format of other programs.

    `slamgauge export FORMAT --help` describes each format.

    For example:
      slamgauge export mat first-run
      slamgauge export latex results/q1 --columns ate_m,nees_pose_per_dof
      slamgauge export figures first-run --width column --estimators ekf,causal
    """

    format: Csv | G2o | Mat | Tum | Latex | Markdown | Figures


def _load(path: Path) -> tuple[files.Recording | None, files.Truth | None, dict[str, files.Estimate]]:
    """Load a recording, an estimate, or the folder of a run or an import."""
    if (path / METRICS).exists():
        _, truth, recording, estimates = files.load_results(path)
        return recording, truth, estimates
    if path.is_dir():
        truth = path / TRUTH
        return files.load_recording(path / RECORDING), files.load_truth(truth) if truth.exists() else None, {}
    record = files.load_recording_or_estimate(path)
    return (record, None, {}) if isinstance(record, files.Recording) else (None, None, {path.stem: record})
