"""Options of `slamgauge import`: a subcommand for each format."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from slamgauge.compare.cli.options.shared import Folder, Options, Repeated


@dataclass
class Format:
    """A format, with its options."""

    path: tyro.conf.Positional[Folder]
    """The log, described above."""

    out: Folder = Path("results/import-NAME")
    """Folder of recording.npz, and of truth.npz and recording.toml if the format has them."""


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
    """

    set: Repeated = field(default_factory=list)
    """Describe the files: section.key=value ..."""


@dataclass
class G2o(Format):
    """A graph with landmarks in the form of g2o, TORO or GTSAM (no ground truth).

    The poses must make up one path. Observations are EDGE_SE2_XY, EDGE_BEARING_SE2_XY, LANDMARK or BR.
    """

    drop_loop_edges: bool = False
    """Drop edges between poses that are not consecutive. Without it they are an error."""

    isam: bool = False
    """ODOMETRY and LANDMARK end with the square root of the information (iSAM), not with a covariance (GTSAM)."""


@dataclass
class Mrclam(Format):
    """One robot of a UTIAS MRCLAM data set, with its ground truth if the folder has it.

    PATH is the folder of Odometry.dat, Measurement.dat, Barcodes.dat, Groundtruth.dat and Landmark_Groundtruth.dat. The
    files contain no noise; the defaults are starting values. Observations of other robots are dropped.
    """

    robot: int | None = None
    """Number of the robot, if the folder has files of several: Robot1_Odometry.dat and so on."""

    forward: float = 0.05
    """Standard deviation of the forward motion in one second [m]. Its variance grows with time."""

    lateral: float = 0.01
    """Standard deviation of the sideways motion in one second [m]."""

    turn: float = 0.05
    """Standard deviation of the turn in one second [rad]."""

    range_sigma: float = 0.15
    """Standard deviation of ranges [m]."""

    bearing_sigma: float = 0.05
    """Standard deviation of bearings [rad]."""


@dataclass
class VictoriaPark(Format):
    """The Victoria Park recording, victoria_park.txt as distributed with the examples of GTSAM (no ground truth)."""

    max_range: float = math.inf
    """Drop observations of landmarks beyond this range [m]."""


@dataclass
class LostInTheWoods(Format):
    """The Lost in the Woods recording (University of Toronto, AER1513), dataset2.mat, with ground truth."""

    max_range: float = 5.0
    """Drop observations of landmarks beyond this range [m]."""

    lateral_slip: float = 0.02
    """Standard deviation of the sideways velocity that estimators assume [m/s]."""


@dataclass
class Bag(Format):
    """A ROS bag: odometry, observations of landmarks and, if you name its topic, ground truth (extra `ros`).

    PATH is a .bag file of ROS 1, the folder of a ROS 2 bag, or a .mcap or .db3 file. --list prints its topics.

    Odometry is nav_msgs/Odometry or geometry_msgs/TwistStamped. Types of observations with known paths are vision_msgs,
    apriltag_ros, fiducial_msgs, visualization_msgs and eufs_msgs; other types need paths (docs/your_robot.md).

    Give the noise that the messages do not contain, for example: --set noise.forward=0.05 noise.turn=0.02 [m/s, rad/s].
    """

    set: Repeated = field(default_factory=list)
    """Settings: section.key=value ..., for example truth.topic=/ground_truth odometry.kind=poses."""

    mapping: Folder | None = None
    """A TOML file of settings; --set replaces single ones."""

    msgs: list[Folder] = field(default_factory=list)
    """Folders with .msg files of message types that the bag does not define."""

    topics: Annotated[bool, tyro.conf.arg(name="list")] = False
    """Print topics, types, numbers of messages and a proposed mapping, and import nothing."""


@dataclass
class Import(Options):
    """Convert the log of a robot or a published recording to recording.npz (and truth.npz).

    `slamgauge import FORMAT --help` describes each format.

    For example:
      slamgauge import csv my-log --set noise.forward=0.02 noise.turn=0.01
      slamgauge evaluate results/import-my-log/recording.npz
    """

    format: Csv | G2o | Bag | Mrclam | VictoriaPark | LostInTheWoods
