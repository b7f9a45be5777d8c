"""Recordings from other programs: `slamgauge import FORMAT`, a subcommand for each format."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from slamgauge.compare.cli.common import Repeated, flattened, results_of
from slamgauge.compare.datasets import bag_log, csv_log, g2o, imported_log, plausibility, published
from slamgauge.compare.storage import files, staged_folder
from slamgauge.compare.storage.result_files import MAPPING, RECORDING, TRUTH


@dataclass
class Format:
    """A format, with its options.

    Attributes:
        path: The log, described above.
        out: Folder of recording.npz, and of truth.npz and recording.toml if the format has them. If not given:
            results/import-NAME.
    """

    path: tyro.conf.Positional[Path]
    out: Path | None = None

    def read(self) -> imported_log.Imported:
        """Return the recording, and the truth if the log has it."""
        raise NotImplementedError

    def options(self) -> dict[str, Any]:
        """Return the options of the format, which are the keyword arguments of its reader."""
        return {name: value for name, value in vars(self).items() if name not in ("path", "out")}

    def run(self) -> int:
        out = self.out or results_of("import", self.path)
        with staged_folder.staged_folder(out, RECORDING) as folder:
            log = self.read()
            facts, doubts = plausibility.examine(log, self.path)
            files.save(folder / RECORDING, log.recording)
            if log.truth is not None:
                files.save(folder / TRUTH, log.truth)
            if log.mapping is not None:
                files.write_toml(folder / MAPPING, log.mapping)
        table = [f"{name:<34}{value}" for name, value in facts.items()]
        warnings = [f"warning: {doubt}" for doubt in doubts]
        counts = f"{log.recording.steps} steps, {len(log.recording.observation)} observations"
        written = f"{counts}, {'no' if log.truth is None else 'with'} ground truth: written to {out}"
        print(*log.notes, *table, *warnings, written, sep="\n", file=sys.stderr)
        return 0


@dataclass
class Csv(Format):
    """CSV files of your own robot: odometry, observations and, if you have it, ground truth.

    PATH is the folder of the files, or a recording.toml with any name.

    odometry.csv has columns stamp,dx,dy,dtheta or stamp,v,omega or stamp,x,y,theta: increments, velocities or poses.

    observations.csv has stamp,landmark,range,bearing or stamp,landmark,bearing or stamp,landmark,x,y (x forward).

    truth.csv with stamp,x,y,theta and landmarks.csv with landmark,x,y are read if they are in the same folder.

    For other names, columns and units, write recording.toml or give --set (docs/your_robot.md). The noise is always
    needed, for example: --set noise.forward=0.02 noise.turn=0.01 noise.range=0.1 noise.bearing=0.03 [m, rad].

    An observation between two rows of odometry splits the step between them. A folder that `slamgauge export` wrote as
    csv needs no options.

    Attributes:
        set: Describe the files: section.key=value ...
    """

    set: Repeated = field(default_factory=list)

    def read(self) -> imported_log.Imported:
        return csv_log.read_csv_log(self.path, flattened(self.set))


@dataclass
class G2o(Format):
    """A graph with landmarks in the form of g2o, TORO or GTSAM (no ground truth).

    The poses must make up one path. Observations are EDGE_SE2_XY, EDGE_BEARING_SE2_XY, LANDMARK or BR.

    Attributes:
        drop_loop_edges: Drop edges between poses that are not consecutive. Without it they are an error.
        isam: ODOMETRY and LANDMARK end with the square root of the information (iSAM), not with a covariance (GTSAM).
    """

    drop_loop_edges: bool = False
    isam: bool = False

    def read(self) -> imported_log.Imported:
        return g2o.read_g2o(self.path, **self.options())


@dataclass
class Mrclam(Format):
    """One robot of a UTIAS MRCLAM data set, with its ground truth if the folder has it.

    PATH is the folder of Odometry.dat, Measurement.dat, Barcodes.dat, Groundtruth.dat and Landmark_Groundtruth.dat. The
    files contain no noise; the defaults are starting values. Observations of other robots are dropped.

    Attributes:
        robot: Number of the robot, if the folder has files of several: Robot1_Odometry.dat and so on.
        forward: Standard deviation of the forward motion in one second [m]. Its variance grows with time.
        lateral: Standard deviation of the sideways motion in one second [m].
        turn: Standard deviation of the turn in one second [rad].
        range_sigma: Standard deviation of ranges [m].
        bearing_sigma: Standard deviation of bearings [rad].
    """

    robot: int | None = None
    forward: float = 0.05
    lateral: float = 0.01
    turn: float = 0.05
    range_sigma: float = 0.15
    bearing_sigma: float = 0.05

    def read(self) -> imported_log.Imported:
        return published.read_mrclam(self.path, **self.options())


@dataclass
class VictoriaPark(Format):
    """The Victoria Park recording, victoria_park.txt as distributed with the examples of GTSAM (no ground truth).

    Attributes:
        max_range: Drop observations of landmarks beyond this range [m].
    """

    max_range: float = math.inf

    def read(self) -> imported_log.Imported:
        recording = g2o.read_g2o(self.path).recording
        return imported_log.Imported(recording.only((recording.observation**2).sum(axis=1) ** 0.5 <= self.max_range))


@dataclass
class LostInTheWoods(Format):
    """The Lost in the Woods recording (University of Toronto, AER1513), dataset2.mat, with ground truth.

    Attributes:
        max_range: Drop observations of landmarks beyond this range [m].
        lateral_slip: Standard deviation of the sideways velocity that estimators assume [m/s].
    """

    max_range: float = 5.0
    lateral_slip: float = 0.02

    def read(self) -> imported_log.Imported:
        return published.read_lost_in_the_woods(self.path, **self.options())


@dataclass
class Bag(Format):
    """A ROS bag: odometry, observations of landmarks and, if you name its topic, ground truth (extra `ros`).

    PATH is a .bag file of ROS 1, the folder of a ROS 2 bag, or a .mcap or .db3 file. --list prints its topics.

    Odometry is nav_msgs/Odometry or geometry_msgs/TwistStamped. Types of observations with known paths are vision_msgs,
    apriltag_ros, fiducial_msgs, visualization_msgs and eufs_msgs; other types need paths (docs/your_robot.md).

    Give the noise that the messages do not contain, for example: --set noise.forward=0.05 noise.turn=0.02 [m/s, rad/s].

    Attributes:
        set: Settings: section.key=value ..., for example truth.topic=/ground_truth odometry.kind=poses.
        mapping: A TOML file of settings; --set replaces single ones.
        msgs: Folders with .msg files of message types that the bag does not define.
    """

    set: Repeated = field(default_factory=list)
    mapping: Path | None = None
    msgs: list[Path] = field(default_factory=list)
    topics: Annotated[
        bool,
        tyro.conf.arg(
            name="list", help="Print topics, types, numbers of messages and a proposed mapping, and import nothing."
        ),
    ] = False

    def read(self) -> imported_log.Imported:
        return bag_log.read_bag(self.path, self.mapping, flattened(self.set), self.msgs)

    def run(self) -> int:
        if not self.topics:
            return super().run()
        print(bag_log.topics_text(self.path, self.msgs))
        return 0


@dataclass
class Command:
    """Convert the log of a robot or a published recording to recording.npz (and truth.npz).

    `slamgauge import FORMAT --help` describes each format.

    For example:
      slamgauge import csv my-log --set noise.forward=0.02 noise.turn=0.01
      slamgauge evaluate results/import-my-log/recording.npz
    """

    format: Csv | G2o | Bag | Mrclam | VictoriaPark | LostInTheWoods
