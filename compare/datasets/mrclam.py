"""One robot's log of the UTIAS Multi-Robot Cooperative Localization and Mapping data (Leung et al., IJRR 30(8), 2011).

    Odometry.dat               time [s], forward velocity [m/s], yaw rate [rad/s]: in force until the next line
    Measurement.dat            time [s], barcode, range [m], bearing [rad]
    Barcodes.dat               subject, barcode
    Groundtruth.dat            time [s], x [m], y [m], heading [rad]; may be missing
    Landmark_Groundtruth.dat   subject, x [m], y [m], and two standard deviations; used beside the last alone

Odometry, Measurement and Groundtruth may have the robot's prefix, as in the archive: `Robot1_Odometry.dat`. Subjects 1
to 5 are robots, and no landmarks. With ground truth the log begins at the first odometry for which there is some, and
the start is known exactly; else it begins at the origin. Observations are put on the odometry as `timeline` says.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.compare.datasets.imported_log import Imported, diagonal_covariances, of_file, require_sigmas
from slamgauge.compare.datasets.synchronisation import (
    Odometry,
    constant_twist,
    interpolated,
    joined,
    require_turns,
)
from slamgauge.compare.datasets.text_lines import Line, read_table, require_order, require_ranges
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import wrap
from slamgauge.truth import Truth

ROBOTS = 5
MAX_GAP = 1.0  # s without ground truth beyond which none is made up


def read_mrclam(
    folder: Path,
    *,
    robot: int | None = None,
    forward: float = 0.05,
    lateral: float = 0.01,
    turn: float = 0.05,
    range_sigma: float = 0.15,
    bearing_sigma: float = 0.05,
) -> Imported:
    """The recording of one robot, `range-bearing` and with subjects for ids, and its ground truth.

    The files state no noise; the defaults are starting values, not measurements. Each of the seven parameters is an
    option of `slamgauge import mrclam`.

    Args:
        folder: Of the files.
        robot: Number of the robot in the files' names; None if there is but one.
        forward: Standard deviation of the way forward in a second [m], whose variance grows with time.
        lateral: The same sideways [m].
        turn: The same of the heading [rad].
        range_sigma: Standard deviation of ranges [m].
        bearing_sigma: Standard deviation of bearings [rad].

    Raises:
        UserError: With the file, the line and the remedy.
    """
    require_sigmas(forward=forward, lateral=lateral, turn=turn, range=range_sigma, bearing=bearing_sigma)
    prefix = _prefix(folder, robot)
    ground = _read_poses(folder / f"{prefix}Groundtruth.dat")
    lines, commands, notes = _read_commands(folder / f"{prefix}Odometry.dat", ground)
    odometry = _odometry(lines, commands, np.array([forward, lateral, turn]))
    sights, landmark, more = _read_sights(folder, prefix)
    odometry, steps, inside, outside = joined(odometry, sights[:, 0])
    sights, landmark = sights[inside], landmark[inside]
    poses = None if ground is None else interpolated(ground[:, 0], ground[:, 1:], odometry.stamps, MAX_GAP)
    truth = _truth(folder / "Landmark_Groundtruth.dat", poses, landmark)
    with of_file(folder):
        recording = Recording(
            stamps=odometry.stamps,
            prior_mean=np.zeros(3) if poses is None else poses[0],
            prior_cov=np.zeros((3, 3)),
            odometry=odometry.increments,
            odometry_cov=odometry.covs,
            sensor="range-bearing",
            observation_step=steps,
            observation=np.column_stack([sights[:, 2], wrap(sights[:, 3])]),
            observation_cov=diagonal_covariances(np.tile([range_sigma, bearing_sigma], (len(sights), 1))),
            landmark=landmark,
        )
    return Imported(recording, truth, (*notes, *more, *outside))


def _prefix(folder: Path, robot: int | None) -> str:
    """What stands before the names of the robot's files."""
    if robot is not None:
        return f"Robot{robot}_"
    if (folder / "Odometry.dat").exists():
        return ""
    found = sorted(path.name.removesuffix("Odometry.dat") for path in folder.glob("Robot*_Odometry.dat"))
    if len(found) == 1:
        return found[0]
    robots = ", ".join(name[5:-1] for name in found)
    remedy = f"choose one of {robots} with --robot" if found else "give the folder of an MRCLAM data set"
    raise UserError(f"{folder}: {'logs of several robots' if found else 'no Odometry.dat in it'}; {remedy}")


def _in_time(path: Path, form: str) -> tuple[list[Line], Float]:
    """The table of a file whose first column is time; of lines at one time the last counts."""
    lines, table = read_table(path, form)
    require_order(lines, table[:, 0], strict=False)
    last = np.diff(table[:, 0], append=np.inf) > 0.0
    return [lines[at] for at in np.flatnonzero(last)], table[last]


def _read_commands(path: Path, ground: Float | None) -> tuple[list[Line], Float, list[str]]:
    """Time, velocity and yaw rate (n, 3) from the ground truth's begin on, their lines, and what was left out."""
    lines, commands = _in_time(path, "time velocity yaw-rate")
    begin = 0 if ground is None else _first_known(ground, commands[:, 0], path)
    if len(commands) < begin + 2:
        raise UserError(f"{path}: fewer than two moments of odometry; give the whole log")
    notes = [f"{begin} lines of odometry are before the ground truth and left out"] if begin else []
    return lines[begin:], commands[begin:], notes


def _odometry(lines: list[Line], commands: Float, sigmas: Float) -> Odometry:
    """Each command in force until the next, with noise whose variance grows with time."""
    seconds = np.diff(commands[:, 0])
    velocities = np.column_stack([commands[:-1, 1], np.zeros(len(seconds)), commands[:-1, 2]])
    increments = constant_twist(velocities, seconds)
    require_turns(lines, increments)
    return Odometry(commands[:, 0], increments, diagonal_covariances(sigmas * np.sqrt(seconds)[:, None]))


def _read_sights(folder: Path, prefix: str) -> tuple[Float, Int, list[str]]:
    """Time, barcode, range and bearing (M, 4) of landmarks, their subjects (M,), and what was left out."""
    barcodes, _ = read_table(folder / "Barcodes.dat", "subject barcode")
    subject_of = {line.id_at(1): line.id_at(0) for line in barcodes}
    lines, sights = read_table(folder / f"{prefix}Measurement.dat", "time barcode range bearing")
    require_order(lines, sights[:, 0], strict=False)
    require_ranges(lines, sights[:, 2])
    subjects = np.array([subject_of.get(line.id_at(1), -1) for line in lines], dtype=np.int64)
    left_out: dict[str, Marks] = {
        "are of other robots": (subjects >= 1) & (subjects <= ROBOTS),
        "have a barcode that Barcodes.dat does not know": subjects == -1,
    }
    notes = [f"{np.sum(marks)} observations {why} and are left out" for why, marks in left_out.items() if marks.any()]
    kept = ~np.logical_or.reduce([*left_out.values()])
    return sights[kept], subjects[kept], notes


def _read_poses(path: Path) -> Float | None:
    """Time and pose (n, 4) of the ground truth, if there is any."""
    return _in_time(path, "time x y heading")[1] if path.exists() else None


def _first_known(ground: Float, stamps: Float, path: Path) -> int:
    """Index of the first stamp for which there is ground truth."""
    known = ~np.isnan(interpolated(ground[:, 0], ground[:, 1:], stamps, MAX_GAP)[:, 0])
    if not known.any():
        raise UserError(f"{path}: no ground truth for any time in it; give files of one data set, or none of the truth")
    return int(np.argmax(known))


def _truth(path: Path, poses: Float | None, landmark: Int) -> Truth | None:
    """The truth of the path and, in the same frame, of the landmarks; none without a path."""
    if poses is None or not path.exists():
        return None if poses is None else Truth(poses=poses, association=landmark)
    lines, table = read_table(path, "subject x y x-sigma y-sigma")
    ids = np.array([line.id_at(0) for line in lines], dtype=np.int64)
    with of_file(path):
        return Truth(poses=poses, landmark_ids=ids, landmarks=table[:, 1:3], association=landmark)
