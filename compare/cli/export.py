"""Recordings, estimates, tables and figures for other programs: `slamgauge export`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import tyro

from slamgauge.compare.cli.options import Folder, named_after, split_names
from slamgauge.compare.cli.terminal import put
from slamgauge.errors import UserError

if TYPE_CHECKING:
    from slamgauge.arrays import Float
    from slamgauge.compare.figures.plot_style import Format
    from slamgauge.estimate import Estimate
    from slamgauge.recording import Recording
    from slamgauge.truth import Truth


OUT = Path("results/export-NAME")
STANDARD_OUTPUT = Path("-")
ENDINGS = {"csv": ".csv", "g2o": ".g2o", "mat": ".mat", "tum-cov": ".tum"}
TABLES = ("latex", "markdown")
FIGURES = ("pdf", "png", "svg")


@dataclass
class Export:
    """Write a recording, a run, an estimate, or the table or figures of a study in a format of other programs.

    csv: a recording as three files in a folder, or the path and map of an estimate (docs/your_filter.md). g2o: a
    recording as a graph. mat: everything, for Octave and MATLAB. tum-cov: the poses and covariances of an estimate.

    From the folder of a study: its table of means with 95 % intervals. csv: with full precision. latex: with booktabs
    and a caption. markdown. Without --out it is printed on standard output.

    From the folder of a run, a study, a sweep, an error budget, noise or bench: its figures, redrawn for a paper. pdf,
    png, svg.

    For example:
      slamgauge export first-run --format mat
      slamgauge export results/q1 --format latex --columns ate_m,nees_pose_per_dof
      slamgauge export first-run --format pdf --width column --estimators ekf,causal
    """

    path: tyro.conf.Positional[Path]
    """A recording.npz, an estimate of a run (FOLDER/estimates/NAME.npz), or the folder of a run or a study."""

    format: Literal["csv", "g2o", "mat", "tum-cov", "latex", "markdown", "pdf", "png", "svg"]
    """The format. From the folder of a run, csv and g2o take the recording."""

    out: Folder = OUT
    """The file. For a recording as csv and for figures: the folder. - is standard output, for the table of a study."""

    recording: Path | None = None
    """The recording of an estimate, for the time stamps of tum-cov. If not given: the recording of its run."""

    lend: float | None = None
    """For g2o: standard deviation [m, rad] of regularising noise for motions whose covariance is singular."""

    columns: str = ""
    """For a study: comma-separated keys of summary.json that have an interval. If not given: its key columns."""

    estimators: str = ""
    """For a study, and for figures: comma-separated. If not given: all. In the figure of a run the 3-sigma bounds of
    the first are filled."""

    means_only: bool = False
    """For a study: leave out the intervals."""

    width: Literal["column", "page"] = "page"
    """For figures: column is 3.4 in (one of two columns), page is 7.0 in."""

    def __call__(self) -> None:
        from slamgauge.compare.storage.result_files import SUMMARY

        if self.out == STANDARD_OUTPUT and (self.format in FIGURES or not (self.path / SUMMARY).exists()):
            raise UserError("out: - is standard output, which takes a study's table alone; name a file")
        if self.format in FIGURES:
            self._write_figures(self.format)
        elif (self.path / SUMMARY).exists():
            self._write_study_table()
        elif self.format in TABLES or self.columns or self.estimators or self.means_only:
            raise UserError(f"{self.path}: not a study, it has no summary.json; give the --out of a study")
        else:
            self._write_records()

    def _write_figures(self, form: Format) -> None:
        from slamgauge.compare.figures.plot_style import Sheet, printed_on
        from slamgauge.compare.figures.publishing import drawings_of
        from slamgauge.compare.storage.staged_folder import staged_folder

        drawings = drawings_of(self.path, split_names(self.estimators))
        out = named_after(OUT, self.path) if self.out == OUT else self.out
        files = [f"{name}.{form}" for name in drawings]
        with staged_folder(out, files, files[0]) as folder, printed_on(Sheet(self.width, (form,))):
            for draw in drawings.values():
                draw(folder)
            written = [name for name in files if (folder / name).exists()]  # a drawing without data writes no file
        print(f"written to {out}: {', '.join(written)}", file=sys.stderr)

    def _write_study_table(self) -> None:
        from slamgauge.compare.storage.staged_folder import staged_files
        from slamgauge.compare.studies.study_table import study_table

        if self.format not in ("csv", "latex", "markdown"):
            raise UserError(f"format: {self.format} is not for the table of a study; use csv, latex or markdown")
        keys, estimators = split_names(self.columns), split_names(self.estimators)
        text = study_table(self.path, self.format, keys, estimators, intervals=not self.means_only)
        if self.out in (OUT, STANDARD_OUTPUT):
            put(text.rstrip("\n"))
            return
        with staged_files(self.out.parent, [self.out.name]) as folder:
            (folder / self.out.name).write_text(text, encoding="utf-8")
        print(f"written to {self.out}", file=sys.stderr)

    def _write_records(self) -> None:
        """Write recordings and estimates."""
        from slamgauge.compare.datasets.imported_log import of_file
        from slamgauge.compare.storage.csv_folder import LANDMARKS, RECORDING_FILES
        from slamgauge.compare.storage.staged_folder import staged_files, staged_folder

        if self.lend is not None and not 0.0 < self.lend < 1.0:
            raise UserError(f"lend: {self.lend:g} is not a small standard deviation; give one between 0 and 1")
        exported = _load(self.path)
        whole_folder = self.format == "csv" and exported.recording is not None
        if self.out == OUT:
            self.out = Path(f"{named_after(OUT, self.path)}{'' if whole_folder else ENDINGS[self.format]}")
        if not whole_folder and not self.out.name:
            raise UserError(f"out: {self.out} is a folder; name the file to write")
        names = (self.out.name, LANDMARKS) if self.format == "csv" else (self.out.name,)
        staged = (
            staged_folder(self.out, RECORDING_FILES, last=RECORDING_FILES[0])
            if whole_folder
            else staged_files(self.out.parent, names)
        )
        with staged as folder, of_file(self.path):
            self._write(exported, folder if whole_folder else folder / self.out.name)
        print(f"written to {self.out}", file=sys.stderr)

    def _write(self, exported: Exported, out: Path) -> None:
        from slamgauge.compare.datasets.g2o_writer import write_g2o
        from slamgauge.compare.storage.csv_folder import write_estimate_csv, write_recording_csv
        from slamgauge.compare.storage.files import write_tum
        from slamgauge.compare.storage.mat_file import write_mat

        if self.format == "mat":
            write_mat(out, exported.records())
        elif self.format == "tum-cov":
            estimate = exported.single_estimate()
            if estimate.pose_covs is None:
                raise UserError("it has no covariances; its run's folder has trajectories/NAME.tum without them")
            write_tum(out, self._stamps(len(estimate.poses)), estimate.poses, estimate.pose_covs)
        elif self.format == "csv" and exported.recording is None:
            write_estimate_csv(out, exported.single_estimate())
        elif exported.recording is None:
            raise UserError("it is an estimate, not a recording; give recording.npz, or another format")
        elif self.format == "csv":
            write_recording_csv(out, exported.recording)
        else:
            write_g2o(out, exported.recording, lend=self.lend)

    def _stamps(self, count: int) -> Float:
        """Return the time stamps of an estimate with `count` poses."""
        from slamgauge.compare.storage.files import load_recording

        folder = self.path if self.path.is_dir() else self.path.parent.parent
        path = self.recording or folder / "recording.npz"
        if self.recording is None and not path.exists():
            raise UserError("its time stamps are in the recording of its run; give that with --recording")
        stamps = load_recording(path).stamps
        if len(stamps) != count:
            raise UserError(f"it has {count} poses, but {path} has {len(stamps)}; give its own with --recording")
        return stamps


class Exported(NamedTuple):
    """The records at a path."""

    recording: Recording | None
    truth: Truth | None
    estimates: dict[str, Estimate]

    def records(self) -> dict[str, Recording | Truth | Estimate]:
        """Return all records by name."""
        found = {"recording": self.recording, "truth": self.truth}
        return {name: record for name, record in found.items() if record is not None} | self.estimates

    def single_estimate(self) -> Estimate:
        """Return the estimate if there is exactly one."""
        if len(self.estimates) != 1:
            raise UserError(f"it has {len(self.estimates)} estimates; give one, as FOLDER/estimates/NAME.npz")
        return next(iter(self.estimates.values()))


def _load(path: Path) -> Exported:
    """Load a recording, an estimate, or the folder of a run or an import."""
    from slamgauge.compare.storage.files import load_recording, load_recording_or_estimate, load_truth
    from slamgauge.compare.storage.result_files import METRICS, RECORDING, TRUTH
    from slamgauge.compare.storage.stored_results import load_results
    from slamgauge.estimate import Estimate

    if (path / METRICS).exists():
        results = load_results(path)
        return Exported(results.recording, results.truth, results.estimates)
    if path.is_dir():
        truth = path / TRUTH
        return Exported(load_recording(path / RECORDING), load_truth(truth) if truth.exists() else None, {})
    record = load_recording_or_estimate(path)
    return Exported(None, None, {path.stem: record}) if isinstance(record, Estimate) else Exported(record, None, {})
