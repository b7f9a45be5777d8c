"""Options of `slamgauge export`: a subcommand for each format."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import tyro

from slamgauge.compare.cli.options.shared import Folder, Options

OUT = Path("results/export-NAME")
STANDARD_OUTPUT = Path("-")


@dataclass
class ExportFormat:
    """A format, with its options."""

    path: tyro.conf.Positional[Path]
    """What is exported, described above."""

    out: Folder = OUT
    """The file or folder that is written."""


@dataclass
class StudyTable(ExportFormat):
    """The table of a study: its means with 95 % intervals. Without --out it is printed on standard output."""

    form: ClassVar[Literal["csv", "latex", "markdown"]]

    columns: str = ""
    """Comma-separated keys of summary.json that have an interval. If not given: its key columns."""

    estimators: str = ""
    """Comma-separated. If not given: all."""

    means_only: bool = False
    """Leave out the intervals."""


@dataclass
class Csv(StudyTable):
    """A recording as three files in a folder, the path and map of an estimate, or the table of a study.

    PATH is a recording.npz, an estimate of a run (FOLDER/estimates/NAME.npz), or the folder of a run or a study. A
    folder of a run stands for its recording. docs/your_filter.md describes the files.
    """

    form = "csv"


@dataclass
class Latex(StudyTable):
    """The table of a study for LaTeX, with booktabs and a caption. Without --out it is printed on standard output."""

    form = "latex"


@dataclass
class Markdown(StudyTable):
    """The table of a study for Markdown. Without --out it is printed on standard output."""

    form = "markdown"


@dataclass
class G2o(ExportFormat):
    """A recording as a graph. PATH is a recording.npz, or the folder of a run or an import."""

    lend: float | None = None
    """Standard deviation [m, rad] of regularising noise for motions whose covariance is singular."""


@dataclass
class Mat(ExportFormat):
    """Everything, for Octave and MATLAB. PATH is a recording, an estimate, or the folder of a run."""


@dataclass
class Tum(ExportFormat):
    """Poses and covariances of an estimate: lines `t x y z qx qy qz qw`, then the upper triangle of the covariance."""

    recording: Path | None = None
    """The recording with the time stamps. If not given: the recording of its run."""


@dataclass
class Figures(ExportFormat):
    """The figures of a run, a study, a sweep, an error budget, noise or bench, redrawn for a paper, in a folder."""

    form: ClassVar[Literal["pdf", "png", "svg"]]

    width: Literal["column", "page"] = "page"
    """column is 3.4 in (one of two columns), page is 7.0 in."""

    estimators: str = ""
    """Comma-separated. If not given: all. In the figure of a run the 3-sigma bounds of the first are filled."""


@dataclass
class Pdf(Figures):
    """The figures of a run, a study, a sweep, an error budget, noise or bench as PDF, redrawn for a paper."""

    form = "pdf"


@dataclass
class Png(Figures):
    """The figures of a run, a study, a sweep, an error budget, noise or bench as PNG, redrawn for a paper."""

    form = "png"


@dataclass
class Svg(Figures):
    """The figures of a run, a study, a sweep, an error budget, noise or bench as SVG, redrawn for a paper."""

    form = "svg"


@dataclass
class Export(Options):
    """Write recordings, estimates, tables of studies and figures in a format of other programs.

    `slamgauge export FORMAT --help` describes each format.

    For example:
      slamgauge export mat first-run
      slamgauge export latex results/q1 --columns ate_m,nees_pose_per_dof
      slamgauge export pdf first-run --width column --estimators ekf,causal
    """

    format: Csv | G2o | Mat | Tum | Latex | Markdown | Pdf | Png | Svg
