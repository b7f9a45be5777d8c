"""Trajectories with stamps in files: TUM, and CSV with a column `stamp`.

A TUM file has lines `t x y z qx qy qz qw`. The upper triangle of a covariance may follow: 6 numbers for (x, y,
heading), or 21 for (x, y, z, roll, pitch, yaw). Only the planar parts are used.

A CSV file has the columns `stamp,x,y,theta`, with or without those of a covariance (`csv_folder`). The stamp may also
be called `time`, `timestamp` or `t`, and the heading `heading` or `yaw`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.storage.covariance_columns import from_triangles
from slamgauge.compare.storage.csv_folder import POSE, POSE_COV
from slamgauge.compare.storage.files import read_text
from slamgauge.compare.storage.spatial_poses import planar_covariances, planar_poses
from slamgauge.compare.storage.text_lines import Line, csv_lines, read_lines, read_whole, rows_below
from slamgauge.errors import UserError
from slamgauge.notices import tell_once

UNIT, TILTED = 1e-3, 0.1  # largest error of a quaternion's length, and qx or qy of a robot that stands level
WORDS = {"time": "stamp", "timestamp": "stamp", "t": "stamp", "heading": "theta", "yaw": "theta"}
TUM = 8  # columns without covariances
TRIANGLES = (6, 21)  # numbers of values in the triangle of a covariance of x, y, heading, or of a pose in space


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
    return path.suffix != ".csv" or _header(csv_lines(path, read_text(path)))[:1] == ["stamp"]


def read_trajectory(path: Path) -> Trajectory:
    """Read poses with stamps from a CSV file, or from a TUM file of any other ending.

    Raises:
        UserError: the file cannot be read or a line is wrong; the message names the line.
    """
    if path.suffix == ".csv":
        lines = csv_lines(path, read_whole(path))
        lines[:1] = [replace(line, words=_header(lines)) for line in lines[:1]]
        rows = _sorted(rows_below(path, lines, ("stamp", *POSE), ("stamp", *POSE, *POSE_COV)))
        covs = from_triangles(rows[:, 4:], 3) if rows.shape[1] > 4 else None
        return Trajectory(str(path), rows[:, 0], rows[:, 1:4], covs)
    table = _sorted(_tum_table(path))
    _require_headings(path, table[:, 4:TUM])
    covs = _covariances(table[:, TUM:]) if table.shape[1] > TUM else None
    return Trajectory(str(path), table[:, 0], planar_poses(table[:, 1:TUM]), covs)


def _sorted(rows: Float) -> Float:
    return rows[np.argsort(rows[:, 0], kind="stable")]


def _header(lines: list[Line]) -> list[str]:
    """Return the names of the columns, with our words for the stamp and the heading."""
    return [WORDS.get(word, word) for line in lines[:1] for word in line.words]


def _tum_table(path: Path) -> Float:
    """Return the numbers (n, columns) of a TUM file."""
    lines = read_lines(path, separator=",")
    for line in lines:
        if len(line.words) - TUM not in (0, *TRIANGLES):
            counts = ", ".join(str(TUM + more) for more in (0, *TRIANGLES))
            raise line.refused(f"{len(line.words)} columns", f"write {counts} numbers, t x y z qx qy qz qw first")
    if len({len(line.words) for line in lines}) > 1:
        raise UserError(f"{path}: lines have different numbers of columns; write all with, or all without covariances")
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


def _covariances(triangles: Float) -> Float:
    """Return the covariances (n, 3, 3) of x, y and heading from upper triangles (n, 6) or (n, 21)."""
    is_planar = triangles.shape[1] == TRIANGLES[0]
    return from_triangles(triangles, 3) if is_planar else planar_covariances(from_triangles(triangles, 6))
