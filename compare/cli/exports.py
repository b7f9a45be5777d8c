"""Recordings, estimates, tables and figures for other programs: `slamgauge export FORMAT`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

from slamgauge.arrays import Float
from slamgauge.compare.cli.options.exports import (
    OUT,
    STANDARD_OUTPUT,
    Csv,
    Export,
    ExportFormat,
    Figures,
    G2o,
    Mat,
    StudyTable,
    Tum,
)
from slamgauge.compare.cli.options.shared import named_after, split_names
from slamgauge.compare.cli.terminal import put
from slamgauge.compare.datasets.g2o_writer import write_g2o
from slamgauge.compare.datasets.imported_log import of_file
from slamgauge.compare.storage.csv_folder import LANDMARKS, START, write_estimate_csv, write_recording_csv
from slamgauge.compare.storage.files import (
    load_recording,
    load_recording_or_estimate,
    load_results,
    load_truth,
    write_mat,
)
from slamgauge.compare.storage.result_files import METRICS, RECORDING, SUMMARY, TRUTH
from slamgauge.compare.storage.staged_folder import staged_files, staged_folder
from slamgauge.compare.storage.trajectories import write_tum
from slamgauge.compare.studies.stored_study import study_table
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

ENDINGS: dict[type[ExportFormat], str] = {Csv: ".csv", G2o: ".g2o", Mat: ".mat", Tum: ".tum"}


def run(command: Export) -> None:
    """Write the figures, the table of a study, or the records at a path."""
    given = command.format
    is_study = (given.path / SUMMARY).exists()
    is_table = isinstance(given, StudyTable) and is_study
    if given.out == STANDARD_OUTPUT and not is_table:
        raise UserError("out: - is standard output, which takes a study's table alone; name a file")
    if isinstance(given, Figures):
        _write_figures(given)
    elif isinstance(given, StudyTable) and is_study:
        _write_table(given)
    elif is_study:
        raise UserError(f"{given.path}: a study; its table is written as csv, latex or markdown")
    elif isinstance(given, StudyTable) and (type(given) is not Csv or _has_table_options(given)):
        raise UserError(f"{given.path}: not a study, it has no summary.json; give the --out of a study")
    else:
        _write_records(given)


def _has_table_options(given: StudyTable) -> bool:
    return bool(given.columns or given.estimators or given.means_only)


def _write_figures(given: Figures) -> None:
    from slamgauge.compare.figures.plot_style import Sheet, printed_on  # here: matplotlib is slow to start
    from slamgauge.compare.figures.publishing import drawings_of

    drawings = drawings_of(given.path, split_names(given.estimators))
    out = named_after(OUT, given.path) if given.out == OUT else given.out
    files = [f"{name}.{given.form}" for name in drawings]
    with staged_folder(out, files[0]) as folder, printed_on(Sheet(given.width, (given.form,))):
        for draw in drawings.values():
            draw(folder)
        written = [name for name in files if (folder / name).exists()]  # a drawing without data writes no file
    print(f"written to {out}: {', '.join(written)}", file=sys.stderr)


def _write_table(given: StudyTable) -> None:
    keys, estimators = split_names(given.columns), split_names(given.estimators)
    text = study_table(given.path, given.form, keys, estimators, intervals=not given.means_only)
    if given.out in (OUT, STANDARD_OUTPUT):
        put(text.rstrip("\n"))
        return
    with staged_files(given.out.parent, [given.out.name]) as folder:
        (folder / given.out.name).write_text(text, encoding="utf-8")
    print(f"written to {given.out}", file=sys.stderr)


def _write_records(given: ExportFormat) -> None:
    """Write recordings and estimates."""
    if isinstance(given, G2o) and given.lend is not None and not 0.0 < given.lend < 1.0:
        raise UserError(f"lend: {given.lend:g} is not a small standard deviation; give one between 0 and 1")
    exported = _load(given.path)
    out = given.out
    if isinstance(given, Csv) and exported.recording is not None:
        out = named_after(OUT, given.path) if out == OUT else out
        with staged_folder(out, START) as folder, of_file(given.path):
            write_recording_csv(folder, exported.recording)
    else:
        out = Path(f"{named_after(OUT, given.path)}{ENDINGS[type(given)]}") if out == OUT else out
        if not out.name:
            raise UserError(f"out: {out} is a folder; name the file to write")
        names = (out.name, LANDMARKS) if isinstance(given, Csv) else (out.name,)
        with staged_files(out.parent, names) as folder, of_file(given.path):
            _write(given, exported, folder / out.name)
    print(f"written to {out}", file=sys.stderr)


def _write(given: ExportFormat, exported: Exported, out: Path) -> None:
    """Write one file."""
    if isinstance(given, Mat):
        write_mat(out, exported.records())
    elif isinstance(given, Tum):
        estimate = exported.single_estimate()
        if estimate.pose_covs is None:
            raise UserError("it has no covariances; its run's folder has trajectories/NAME.tum without them")
        write_tum(out, _stamps(given, len(estimate.poses)), estimate.poses, estimate.pose_covs)
    elif isinstance(given, Csv):
        write_estimate_csv(out, exported.single_estimate())
    elif exported.recording is None:
        raise UserError("it is an estimate, not a recording; give recording.npz, or another format")
    elif isinstance(given, G2o):
        write_g2o(out, exported.recording, lend=given.lend)


def _stamps(given: Tum, count: int) -> Float:
    """Return the time stamps of an estimate with `count` poses."""
    folder = given.path if given.path.is_dir() else given.path.parent.parent
    path = given.recording or folder / RECORDING
    if given.recording is None and not path.exists():
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
    if (path / METRICS).exists():
        results = load_results(path)
        return Exported(results.recording, results.truth, results.estimates)
    if path.is_dir():
        truth = path / TRUTH
        return Exported(load_recording(path / RECORDING), load_truth(truth) if truth.exists() else None, {})
    record = load_recording_or_estimate(path)
    return Exported(None, None, {path.stem: record}) if isinstance(record, Estimate) else Exported(record, None, {})
