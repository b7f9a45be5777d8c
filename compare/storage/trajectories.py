"""Trajectories with stamps in files: TUM, and CSV with a column of stamps; their interpolation, and their planar parts.

A TUM file has lines `t x y z qx qy qz qw`, of which the planar parts are used. The upper triangle of the covariance of
x, y and heading may follow. A CSV file has the columns `stamp,x,y,theta`, with or without those of a covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.storage.csv_folder import POSE, POSE_COV, from_triangles, upper_triangles
from slamgauge.compare.storage.files import explained, read_text
from slamgauge.compare.storage.text_lines import Line, csv_lines, read_table, read_whole, rows_below
from slamgauge.notices import tell_once
from slamgauge.se2 import wrap

UNIT, TILTED = 1e-3, 0.1  # largest error of a quaternion's length, and qx or qy of a robot that stands level
TUM = "t x y z qx qy qz qw"
STAMPS = ("stamp", "time")  # names of the first column of a CSV file with stamps
SAME = 1e-6  # s: nearer stamps are the same; a float64 of today's time in seconds resolves 2e-7 s


class Trajectory(NamedTuple):
    """Poses with stamps of their own."""

    where: str  # file or topic, for messages
    stamps: Float  # (n,) [s], sorted
    poses: Float  # (n, 3) x, y [m], heading [rad]
    covs: Float | None = None  # (n, 3, 3)


def has_stamps(path: Path) -> bool:
    """Return whether a file of poses has stamps, and not steps."""
    if path.suffix != ".csv":
        return True
    return any(line.words[0] in STAMPS for line in csv_lines(path, read_text(path))[:1])


def read_trajectory(path: Path) -> Trajectory:
    """Read poses with stamps from a CSV file, or from a TUM file of any other ending; errors name the line."""
    if path.suffix == ".csv":
        headers = [(stamp, *POSE, *more) for stamp in STAMPS for more in ((), POSE_COV)]
        rows = rows_below(path, read_whole(path), *headers)
        poses, triangles = rows[:, 1:4], rows[:, 4:]
    else:
        lines, rows = read_table(path, TUM, POSE_COV)
        _require_headings(lines, rows[:, 4:8])
        poses, triangles = planar_poses(rows[:, 1:8]), rows[:, 8:]
    order = np.argsort(rows[:, 0], kind="stable")
    covs = from_triangles(triangles)[order] if triangles.shape[1] else None
    return Trajectory(str(path), rows[order, 0], poses[order], covs)


def _require_headings(lines: Sequence[Line], quaternions: Float) -> None:
    """Refuse quaternions (n, 4) in x, y, z, w that are not of unit length, and warn of tilted poses."""
    norms, tilts = np.linalg.norm(quaternions, axis=1), np.abs(quaternions[:, :2]).max(axis=1)
    wrong, most = int(np.abs(norms - 1.0).argmax()), int(tilts.argmax())
    if abs(norms[wrong] - 1.0) > UNIT:
        remedy = "write unit quaternions, 0 0 sin(heading/2) cos(heading/2) in the plane"
        raise lines[wrong].refused(f"the quaternion qx qy qz qw has the length {norms[wrong]:.4g}", remedy)
    if tilts[most] > TILTED:
        what = f"{lines[most].path}, line {lines[most].number}: qx or qy is {tilts[most]:.2f}: the robot is tilted"
        tell_once(f"{what}, or the columns are not in the order qx qy qz qw; only the heading is used")


def write_tum(path: str | Path, stamps: Float, poses: Float, covs: Float | None = None) -> None:
    """Write stamps (N+1,), poses (N+1, 3) and covariances (N+1, 3, 3) as TUM, without poses of NaN.

    evo reads files without covariances.
    """
    x, y, heading = poses.T
    zero = np.zeros_like(x)
    parts = [stamps, x, y, zero, zero, zero, np.sin(heading / 2), np.cos(heading / 2)]
    table = np.column_stack(parts if covs is None else [*parts, upper_triangles(covs)])
    known = table[~np.isnan(poses).any(axis=1)]
    with explained(path, "written"), Path(path).open("w", encoding="ascii") as file:
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
