"""Recordings, estimates, tables and figures for other programs: `slamgauge export FORMAT`."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from slamgauge.compare.cli.common import results_of, split_names
from slamgauge.compare.cli.terminal import put
from slamgauge.compare.datasets import g2o_writer, imported_log
from slamgauge.compare.figures import plot_style, publishing
from slamgauge.compare.storage import csv_folder, files, staged_folder, trajectories
from slamgauge.compare.storage.result_files import METRICS, RECORDING, SUMMARY, TRUTH
from slamgauge.compare.studies import stored_study
from slamgauge.errors import UserError

if TYPE_CHECKING:
    from slamgauge.estimate import Estimate
    from slamgauge.recording import Recording
    from slamgauge.truth import Truth

    Exported = tuple[Recording | None, Truth | None, dict[str, Estimate]]

TABLES, FIGURES = ("csv", "latex", "markdown"), ("pdf", "png", "svg")
FORMATS = {  # which have an option
    "columns": TABLES,
    "estimators": TABLES + FIGURES,
    "means_only": TABLES,
    "width": FIGURES,
    "lend": ("g2o",),
    "recording": ("tum",),
}


@dataclass
class Command:
    """Write recordings, estimates, tables of studies and figures in a format of other programs.

    csv: a recording as three files in a folder, the path and map of an estimate (FOLDER/estimates/NAME.npz), or the
    table of a study. A folder of a run stands for its recording. docs/your_filter.md describes the files.

    g2o: a recording as a graph. tum: poses of an estimate, lines `t x y z qx qy qz qw`, then the upper triangle of the
    covariance, if it has one. mat: everything in a recording, an estimate or a run, for Octave and MATLAB.

    latex (with booktabs), markdown: the table of a study, its means with 95 % intervals, on standard output without
    --out. pdf, png, svg: the figures of a run, a study, a sweep, an error budget, noise or bench, redrawn for a paper.

    For example:
      slamgauge export mat first-run
      slamgauge export latex results/q1 --columns ate_m,nees_pose_per_dof
      slamgauge export pdf first-run --width column --estimators ekf,causal

    Attributes:
        format: The format.
        path: What is exported: a recording.npz, an estimate, or the folder of results or of an import.
        out: The file or folder that is written. If not given: results/export-NAME, with the ending of the format.
        columns: Tables: comma-separated keys of summary.json that have an interval. If not given: its key columns.
        estimators: Tables and figures: comma-separated. If not given: all. In the figure of a run the 3-sigma bounds
            of the first are filled.
        means_only: Tables: leave out the intervals.
        width: Figures: column is 3.4 in (one of two columns), page is 7.0 in.
        lend: g2o: standard deviation [m, rad] of regularising noise for motions whose covariance is singular.
        recording: tum: the recording with the time stamps. If not given: the recording of its run.
    """

    format: tyro.conf.Positional[Literal["csv", "g2o", "mat", "tum", "latex", "markdown", "pdf", "png", "svg"]]
    path: tyro.conf.Positional[Path]
    out: Path | None = None
    columns: str = ""
    estimators: str = ""
    means_only: bool = False
    width: Literal["column", "page"] = "page"
    lend: float | None = None
    recording: Path | None = None

    def run(self) -> int:
        given = [name for name in FORMATS if getattr(self, name) != getattr(Command, name)]
        for name in given:
            if self.format not in FORMATS[name]:
                formats = ", ".join(FORMATS[name])
                raise UserError(f"{name.replace('_', '-')}: an option of {formats}; leave it out for {self.format}")
        match self.format:
            case "pdf" | "png" | "svg" as form:
                return self._figures(form)
            case "latex" | "markdown" as form:
                return self._table(form)
            case "csv" if given or (self.path / SUMMARY).exists():
                return self._table("csv")
        recording, truth, estimates = _load(self.path)
        if self.format == "tum":
            return self._tum(estimates)
        if self.format == "mat":
            records = {"recording": recording, "truth": truth, **estimates}
            found = {name: record for name, record in records.items() if record is not None}
            return self._file(".mat", lambda out: files.write_mat(out, found))
        if self.format == "g2o":
            return self._g2o(recording)
        if recording is None:
            (estimate,) = estimates.values()
            return self._file(".csv", lambda out: csv_folder.write_estimate_csv(out, estimate), csv_folder.LANDMARKS)
        out = self.out or results_of("export", self.path)
        with staged_folder.staged_folder(out, csv_folder.START) as folder, imported_log.of_file(self.path):
            csv_folder.write_recording_csv(folder, recording)
        print(f"written to {out}", file=sys.stderr)
        return 0

    def _file(self, ending: str, write: Callable[[Path], object], *beside: str) -> int:
        """Write one file; `beside` are names of files that `write` may write next to it."""
        out = self.out or Path(f"{results_of('export', self.path)}{ending}")
        with staged_folder.staged_files(out.parent, (out.name, *beside)) as folder, imported_log.of_file(self.path):
            write(folder / out.name)
        print(f"written to {out}", file=sys.stderr)
        return 0

    def _table(self, form: Literal["csv", "latex", "markdown"]) -> int:
        columns, names = split_names(self.columns), split_names(self.estimators)
        text = stored_study.study_table(self.path, form, columns, names, intervals=not self.means_only)
        if self.out is not None:
            return self._file("", lambda out: out.write_text(text, encoding="utf-8"))
        put(text.rstrip("\n"))
        return 0

    def _figures(self, form: Literal["pdf", "png", "svg"]) -> int:
        drawings = publishing.drawings_of(self.path, split_names(self.estimators))
        out, main = self.out or results_of("export", self.path), f"{next(iter(drawings))}.{form}"
        sheet = plot_style.Sheet(self.width, (form,))
        with staged_folder.staged_folder(out, main) as folder, plot_style.printed_on(sheet):
            for draw in drawings.values():
                draw(folder)
            written = sorted(path.name for path in folder.iterdir())
        print(f"written to {out}: {', '.join(written)}", file=sys.stderr)
        return 0

    def _g2o(self, recording: Recording | None) -> int:
        if self.lend is not None and not 0.0 < self.lend < 1.0:
            raise UserError(f"lend: {self.lend:g} is not a small standard deviation; give one between 0 and 1")
        if recording is None:
            raise UserError(f"{self.path}: it is an estimate, not a recording; give recording.npz, or another format")
        return self._file(".g2o", lambda out: g2o_writer.write_g2o(out, recording, lend=self.lend))

    def _tum(self, estimates: dict[str, Estimate]) -> int:
        if len(estimates) != 1:
            what = f"{self.path}: it has {len(estimates)} estimates"
            raise UserError(f"{what}; give one, as FOLDER/estimates/NAME.npz")
        (estimate,) = estimates.values()
        folder = self.path if self.path.is_dir() else self.path.parent.parent
        path = self.recording or folder / RECORDING
        stamps, poses = files.load_recording(path).stamps, estimate.poses
        if len(stamps) != len(poses):
            what = f"{self.path}: it has {len(poses)} poses, but {path} has {len(stamps)}"
            raise UserError(f"{what}; give the recording of its run with --recording")
        return self._file(".tum", lambda out: trajectories.write_tum(out, stamps, poses, estimate.pose_covs))


def _load(path: Path) -> Exported:
    """Load a recording, an estimate, or the folder of a run or an import."""
    if (path / METRICS).exists():
        _, truth, recording, estimates = files.load_results(path)
        return recording, truth, estimates
    if path.is_dir():
        truth = path / TRUTH
        return files.load_recording(path / RECORDING), files.load_truth(truth) if truth.exists() else None, {}
    record = files.load_recording_or_estimate(path)
    return (record, None, {}) if isinstance(record, files.Recording) else (None, None, {path.stem: record})
