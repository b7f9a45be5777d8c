"""Trajectories with stamps in files: TUM, and CSV with a column `stamp`; their interpolation, and their planar parts.

A TUM file has lines `t x y z qx qy qz qw`. The upper triangle of a covariance may follow: 6 numbers for (x, y,
heading), or 21 for (x, y, z, roll, pitch, yaw). Only the planar parts are used.

A CSV file has the columns `stamp,x,y,theta`, with or without those of a covariance (`csv_folder`). The stamp may also
be called `time`, `timestamp` or `t`, and the heading `heading` or `yaw`.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, chunks
from slamgauge.compare.storage.csv_folder import POSE, POSE_COV, from_triangles, upper_triangles
from slamgauge.compare.storage.files import explained, read_text
from slamgauge.compare.storage.text_lines import csv_lines, header_of, read_lines, read_whole, rows_below
from slamgauge.errors import UserError
from slamgauge.notices import tell_once
from slamgauge.se2 import wrap

UNIT, TILTED = 1e-3, 0.1  # largest error of a quaternion's length, and qx or qy of a robot that stands level
WORDS = {"time": "stamp", "timestamp": "stamp", "t": "stamp", "heading": "theta", "yaw": "theta"}
TUM = 8  # columns without covariances
TRIANGLES = (6, 21)  # numbers of values in the triangle of a covariance of x, y, heading, or of a pose in space
PLANAR = (0, 1, 5)  # rows of x, y and heading in a covariance (6, 6) of ROS
SAME = 1e-6  # s: nearer stamps are the same; a float64 of today's time in seconds resolves 2e-7 s


class Trajectory(NamedTuple):
    """Poses with stamps of their own.

    Attributes:
        where: file or topic, for messages.
        stamps: (n,) [s], sorted.
        poses: (n, 3) x, y [m], heading [rad].
        covs: (n, 3, 3), or None.
    """

    where: str
    stamps: Float
    poses: Float
    covs: Float | None = None


def has_stamps(path: Path) -> bool:
    """Return whether a file of poses has stamps, and not steps."""
    return path.suffix != ".csv" or header_of(csv_lines(path, read_text(path)), WORDS)[:1] == ("stamp",)


def read_trajectory(path: Path) -> Trajectory:
    """Read poses with stamps from a CSV file, or from a TUM file of any other ending.

    Raises:
        UserError: the file cannot be read or a line is wrong; the message names the line.
    """
    if path.suffix == ".csv":
        headers = ("stamp", *POSE), ("stamp", *POSE, *POSE_COV)
        rows = _sorted(rows_below(path, read_whole(path), *headers, words=WORDS))
        covs = from_triangles(rows[:, 4:], 3) if rows.shape[1] > 4 else None
        return Trajectory(str(path), rows[:, 0], rows[:, 1:4], covs)
    rows = _sorted(_tum_rows(path))
    _require_headings(path, rows[:, 4:TUM])
    covs = None
    if rows.shape[1] == TUM + TRIANGLES[0]:
        covs = from_triangles(rows[:, TUM:], 3)
    elif rows.shape[1] > TUM:
        covs = planar_covariances(from_triangles(rows[:, TUM:], 6))
    return Trajectory(str(path), rows[:, 0], planar_poses(rows[:, 1:TUM]), covs)


def _sorted(rows: Float) -> Float:
    return rows[np.argsort(rows[:, 0], kind="stable")]


def _tum_rows(path: Path) -> Float:
    """Return the numbers (n, columns) of a TUM file."""
    lines = read_lines(path, separator=",")
    for line in lines:
        if len(line.words) - TUM not in (0, *TRIANGLES):
            counts = ", ".join(str(TUM + more) for more in (0, *TRIANGLES))
            raise line.refused(f"{len(line.words)} columns", f"write {counts} numbers, t x y z qx qy qz qw first")
        if len(line.words) != len(lines[0].words):
            raise line.refused("has another number of columns than the first", "write all with or without covariances")
    return np.array([line.numbers() for line in lines]).reshape(len(lines), -1 if lines else TUM)


def _require_headings(path: Path, quaternions: Float) -> None:
    """Refuse quaternions (n, 4) in x, y, z, w that are not of unit length, and warn of tilted poses."""
    norms = np.linalg.norm(quaternions, axis=1)
    wrong = np.abs(norms - 1.0) > UNIT
    if wrong.any():
        step = int(wrong.argmax())
        what = f"pose {step}: the quaternion qx qy qz qw has the length {norms[step]:.4g}"
        raise UserError(f"{path}: {what}; write unit quaternions, 0 0 sin(heading/2) cos(heading/2) in the plane")
    tilts = np.abs(quaternions[:, :2]).max(axis=1)
    if tilts.max(initial=0.0) > TILTED:
        step = int(tilts.argmax())
        tell_once(
            f"{path}: qx or qy is {tilts[step]:.2f} at pose {step}: the robot is tilted, or the columns are not in the "
            "order qx qy qz qw; only the heading is used"
        )


def write_tum(path: str | Path, stamps: Float, poses: Float, covs: Float | None = None) -> None:
    """Write a trajectory in the TUM format of evo: `t x y z qx qy qz qw`, without rows of NaN.

    With covariances each line continues with the upper triangle (xx xy xt yy yt tt), which evo does not read.

    Args:
        path: Text file.
        stamps: Times (N+1,) [s].
        poses: Poses (N+1, 3): x [m], y [m], heading [rad].
        covs: Covariances (N+1, 3, 3) of the poses.

    Raises:
        UserError: If the file cannot be written.
    """
    with explained(path, "written"), Path(path).open("w", encoding="ascii") as file:
        for rows in chunks(len(poses)):
            x, y, heading = poses[rows].T
            zero = np.zeros_like(x)
            parts = [stamps[rows], x, y, zero, zero, zero, np.sin(heading / 2), np.cos(heading / 2)]
            table = np.column_stack(parts if covs is None else [*parts, upper_triangles(covs[rows])])
            known = table[~np.isnan(poses[rows]).any(axis=1)]
            file.writelines(f"{' '.join(map(repr, row))}\n" for row in known.tolist())


def rotations(quaternions: Float) -> Float:
    """Return matrices (n, 3, 3) of quaternions (n, 4) in x, y, z, w of any length; zeros are the identity."""
    from scipy.spatial.transform import Rotation  # imported here because it is slow and few commands need it

    unset = ~quaternions.any(axis=1, keepdims=True)
    return Rotation.from_quat(np.where(unset, [0.0, 0.0, 0.0, 1.0], quaternions)).as_matrix()


def planar_poses(poses: Float) -> Float:
    """Return x, y and heading (n, 3) of poses (n, 7): position, then quaternion in x, y, z, w."""
    turned = rotations(poses[:, 3:])
    return np.column_stack([poses[:, :2], np.arctan2(turned[:, 1, 0], turned[:, 0, 0])])


def planar_covariances(covs: Float) -> Float:
    """Return covariances (n, 3, 3) of x, y, heading from those, (n, 6, 6) or (n, 36), of x, y, z, roll, pitch, yaw."""
    return covs.reshape(-1, 6, 6)[:, PLANAR][:, :, PLANAR]


def interpolated(stamps: Float, poses: Float, times: Float, max_gap: float) -> Float:
    """Interpolate poses (n, 3) at stamps (n,) to times (M,) [s], headings along the shorter arc.

    Rows are NaN at times outside the stamps, or between two stamps that are more than `max_gap` [s] apart.
    """
    before, after, share = neighbours(stamps, times)
    change = poses[after] - poses[before]
    change[:, 2] = wrap(change[:, 2])
    found = poses[before] + share[:, None] * change
    found[:, 2] = wrap(found[:, 2])
    is_met = np.minimum(np.abs(times - stamps[before]), np.abs(times - stamps[after])) <= SAME
    is_between = (times > stamps[0]) & (times < stamps[-1]) & (stamps[after] - stamps[before] <= max_gap)
    found[~(is_met | is_between)] = np.nan
    return found


def interpolated_covs(stamps: Float, covs: Float, times: Float) -> Float:
    """Interpolate covariances (n, d, d) at stamps (n,) linearly to times (M,) [s]."""
    before, after, share = neighbours(stamps, times)
    return covs[before] + share[:, None, None] * (covs[after] - covs[before])


def neighbours(stamps: Float, times: Float) -> tuple[Int, Int, Float]:
    """Return the rows of the stamps before and after each of times (M,), and its share of the way between them."""
    places = np.interp(times, stamps, np.arange(len(stamps)))
    before = places.astype(np.int64)
    return before, np.minimum(before + 1, len(stamps) - 1), places - before
