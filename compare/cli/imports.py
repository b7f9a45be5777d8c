"""Recordings of others: `slamgauge import`."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from slamgauge.compare.cli.options import (
    Folder,
    Overrides,
    flattened,
    named_after,
)
from slamgauge.compare.storage.result_files import MAPPING, RECORDING, TRUTH

if TYPE_CHECKING:
    from slamgauge.compare.datasets.imported_log import Imported


IMPORTED = (RECORDING, TRUTH, MAPPING)


@dataclass
class Csv:
    """CSV files of a robot of your own: odometry, observations and, if you have it, ground truth.

    odometry.csv has columns stamp,dx,dy,dtheta or stamp,v,omega or stamp,x,y,theta: increments, velocities or poses.

    observations.csv has stamp,landmark,range,bearing or stamp,landmark,bearing or stamp,landmark,x,y (x forward).

    truth.csv with stamp,x,y,theta and landmarks.csv with landmark,x,y may lie beside them.

    Other names, columns and units are said in recording.toml or with --set (docs/your_robot.md), and the noise always,
    for example so: --set noise.forward=0.02 noise.turn=0.01 noise.range=0.1 noise.bearing=0.03 [m, rad].

    An observation between two rows of odometry splits the step between them. A folder that `slamgauge export` has
    written as csv is read as it is.
    """

    path: tyro.conf.Positional[Path]
    """The folder of the files, or a recording.toml of any name."""

    out: Folder = Path("results/import-NAME")
    """Folder for recording.npz, truth.npz and the recording.toml by which the files were read."""

    set: Overrides = field(default_factory=list)
    """Say how the files are to be read: section.key=value ..."""

    def __call__(self) -> None:
        """Read and store."""
        from slamgauge.compare.datasets.csv_log import read_csv_log

        imported, mapping = read_csv_log(self.path, flattened(self.set))
        _store(self.out, imported, mapping)


@dataclass
class G2o:
    """A graph with landmarks in g2o's form, TORO's or GTSAM's (no ground truth).

    Its poses must make up one path; landmarks are seen by EDGE_SE2_XY, EDGE_BEARING_SE2_XY, LANDMARK or BR.
    """

    path: tyro.conf.Positional[Path]
    """The graph."""

    out: Folder = Path("results/import-NAME")
    """Folder for recording.npz."""

    drop_loop_edges: bool = False
    """Leave out edges between poses beside the path, from scan matching for example; else they are refused."""

    isam: bool = False
    """ODOMETRY and LANDMARK lines end with the square root of the information, as iSAM writes them, not with a
    covariance, as GTSAM's copies of its data sets do."""

    def __call__(self) -> None:
        """Read and store."""
        from slamgauge.compare.datasets.g2o import read_g2o

        _store(self.out, read_g2o(self.path, drop_loop_edges=self.drop_loop_edges, isam=self.isam))


@dataclass
class Mrclam:
    """One robot of a UTIAS MRCLAM data set, with its ground truth if that is there.

    The files say nothing of noise: the defaults are a beginning. Sightings of other robots are left out.
    """

    path: tyro.conf.Positional[Path]
    """Folder of Odometry.dat, Measurement.dat, Barcodes.dat, Groundtruth.dat and Landmark_Groundtruth.dat."""

    out: Folder = Path("results/import-NAME")
    """Folder for recording.npz and truth.npz."""

    robot: int | None = None
    """Which robot, where the folder has files of several: Robot1_Odometry.dat and so on."""

    forward: float = 0.05
    """Standard deviation of the way forward in a second [m]; its variance grows with time."""

    lateral: float = 0.01
    """The same of the way sideways [m]."""

    turn: float = 0.05
    """The same of the heading [rad]."""

    range_sigma: float = 0.15
    """Standard deviation of ranges [m]."""

    bearing_sigma: float = 0.05
    """Standard deviation of bearings [rad]."""

    def __call__(self) -> None:
        """Read and store."""
        from slamgauge.compare.datasets.mrclam import read_mrclam

        imported = read_mrclam(
            self.path,
            robot=self.robot,
            forward=self.forward,
            lateral=self.lateral,
            turn=self.turn,
            range_sigma=self.range_sigma,
            bearing_sigma=self.bearing_sigma,
        )
        _store(self.out, imported)


@dataclass
class Dlr:
    """A landmark log of the DLR Spatial Cognition data set, or of its form (no ground truth)."""

    path: tyro.conf.Positional[Path]
    """The log, of lines STEP and LANDMARK."""

    out: Folder = Path("results/import-NAME")
    """Folder for recording.npz."""

    without_ids: bool = False
    """Forget the ids: all observations are kept, and association is up to the filters. Else those with the id -1 are
    left out where others have one."""

    def __call__(self) -> None:
        """Read and store."""
        from slamgauge.compare.datasets.dlr import read_dlr

        _store(self.out, read_dlr(self.path, with_ids=not self.without_ids))


@dataclass
class Freiburg:
    """A log of the SLAM course at Freiburg: sensor_data.dat, with world.dat beside it for the truth of its landmarks.

    The log says nothing of noise: the defaults suit simulated logs; give those of yours.
    """

    path: tyro.conf.Positional[Path]
    """The log, or the folder of both files."""

    out: Folder = Path("results/import-NAME")
    """Folder for recording.npz and truth.npz."""

    rotation_sigma: float = 0.005
    """Standard deviation of each of a step's two turns [rad]."""

    translation_sigma: float = 0.01
    """Standard deviation of a step's way [m]."""

    range_sigma: float = 0.1
    """Standard deviation of ranges [m]."""

    bearing_sigma: float = 0.1
    """Standard deviation of bearings [rad]."""

    def __call__(self) -> None:
        """Read and store."""
        from slamgauge.compare.datasets.freiburg import read_freiburg

        imported = read_freiburg(
            self.path,
            rotation_sigma=self.rotation_sigma,
            translation_sigma=self.translation_sigma,
            range_sigma=self.range_sigma,
            bearing_sigma=self.bearing_sigma,
        )
        _store(self.out, imported)


@dataclass
class VictoriaPark:
    """The Victoria Park recording, as distributed with GTSAM's examples (no ground truth)."""

    path: tyro.conf.Positional[Path]
    """victoria_park.txt"""

    out: Folder = Path("results/import-NAME")
    """Folder for recording.npz."""

    max_range: float = math.inf
    """Drop observations from farther away [m]."""

    def __call__(self) -> None:
        """Read and store."""
        from slamgauge.compare.datasets.imported_log import Imported
        from slamgauge.compare.datasets.victoria_park import read_victoria_park

        _store(self.out, Imported(read_victoria_park(self.path, max_range=self.max_range), None, ()))


@dataclass
class LostInTheWoods:
    """The Lost in the Woods recording (University of Toronto, AER1513), with ground truth."""

    path: tyro.conf.Positional[Path]
    """dataset2.mat"""

    out: Folder = Path("results/import-NAME")
    """Folder for recording.npz and truth.npz."""

    max_range: float = 5.0
    """Drop observations from farther away [m]."""

    lateral_slip: float = 0.02
    """Standard deviation of the sideways velocity that estimators shall assume [m/s]."""

    def __call__(self) -> None:
        """Read and store."""
        from slamgauge.compare.datasets.imported_log import Imported
        from slamgauge.compare.datasets.lost_in_the_woods import read_lost_in_the_woods

        recording, truth = read_lost_in_the_woods(self.path, max_range=self.max_range, lateral_slip=self.lateral_slip)
        _store(self.out, Imported(recording, truth, ()))


@dataclass
class Import:
    """Turn a robot's log or a published recording into recording.npz (and truth.npz).

    `slamgauge import FORMAT --help` says what each format has.

    For example:
      slamgauge import csv my-log --set noise.forward=0.02 noise.turn=0.01
      slamgauge evaluate results/import-my-log/recording.npz
    """

    format: (
        Annotated[Csv, tyro.conf.subcommand(name="csv")]
        | Annotated[G2o, tyro.conf.subcommand(name="g2o")]
        | Annotated[Mrclam, tyro.conf.subcommand(name="mrclam")]
        | Annotated[Dlr, tyro.conf.subcommand(name="dlr")]
        | Annotated[Freiburg, tyro.conf.subcommand(name="freiburg")]
        | Annotated[VictoriaPark, tyro.conf.subcommand(name="victoria-park")]
        | Annotated[LostInTheWoods, tyro.conf.subcommand(name="lost-in-the-woods")]
    )

    def __call__(self) -> None:
        """Read and store."""
        from slamgauge.compare.storage.manifest import require_free

        self.format.out = named_after(self.format.out, self.format.path)
        require_free(self.format.out, IMPORTED)  # before long files are read
        self.format()


def _store(out: Path, imported: Imported, mapping: dict[str, dict[str, Any]] | None = None) -> None:
    from slamgauge.compare.storage.files import save
    from slamgauge.compare.storage.staged_folder import staged_folder
    from slamgauge.compare.storage.toml_tables import write_toml

    recording, truth, notes = imported
    with staged_folder(out, IMPORTED, last=IMPORTED[0]) as folder:
        save(folder / RECORDING, recording)
        if truth is not None:
            save(folder / TRUTH, truth)
        if mapping is not None:
            write_toml(folder / MAPPING, mapping)
    for note in notes:
        print(note, file=sys.stderr)
    print(
        f"{recording.steps} steps, {len(recording.observation)} observations, "
        f"{'with' if truth is not None else 'no'} ground truth: written to {out}",
        file=sys.stderr,
    )
