"""One robot's log of the UTIAS Multi-Robot Cooperative Localization and Mapping data (Leung et al., IJRR 30(8), 2011).

    Odometry.dat               time [s], forward velocity [m/s], yaw rate [rad/s]: valid until the next line
    Measurement.dat            time [s], barcode, range [m], bearing [rad]
    Barcodes.dat               subject, barcode
    Groundtruth.dat            time [s], x [m], y [m], heading [rad]; may be missing
    Landmark_Groundtruth.dat   subject, x [m], y [m], two standard deviations; used only with Groundtruth.dat

Odometry, Measurement and Groundtruth may have the robot's prefix, as in the archive: `Robot1_Odometry.dat`. Subjects 1
to 5 are robots, not landmarks. With ground truth the log begins at the first odometry that has a true pose, and the
start is known exactly; else it begins at the origin. `synchronisation` splits steps at observations.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.compare.datasets.imported_log import Imported, diagonal_covariances, of_file, require_sigmas
from slamgauge.compare.datasets.row_checks import require_bearings, require_order, require_ranges, require_turns
from slamgauge.compare.datasets.synchronisation import Odometry, constant_twist, joined
from slamgauge.compare.storage.text_lines import Line, read_table
from slamgauge.compare.storage.trajectories import interpolated
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import wrap
from slamgauge.truth import Truth

ROBOTS = 5
MAX_GAP = 1.0  # s: ground truth is not interpolated over longer gaps


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
    """Read the recording of one robot, `range-bearing` and with subjects as ids, and its ground truth.

    The files do not contain the noise; the defaults are starting values, not measurements. Each of the seven parameters
    is an option of `slamgauge import mrclam`.

    Args:
        folder: Folder of the files.
        robot: Number of the robot in the files' names; None if the folder has one robot.
        forward: Standard deviation of the forward motion in one second [m]; its variance grows with time.
        lateral: Standard deviation of the sideways motion in one second [m].
        turn: Standard deviation of the turn in one second [rad].
        range_sigma: Standard deviation of ranges [m].
        bearing_sigma: Standard deviation of bearings [rad].

    Raises:
        UserError: With the file, the line and the remedy.
    """
    require_sigmas(forward=forward, lateral=lateral, turn=turn, range=range_sigma, bearing=bearing_sigma)
    prefix = _prefix(folder, robot)
    true_path = folder / f"{prefix}Groundtruth.dat"
    ground = _in_time(true_path, "time x y heading")[1] if true_path.exists() else None
    lines, commands, notes = _read_commands(folder / f"{prefix}Odometry.dat", ground)
    odometry = _odometry(lines, commands, np.array([forward, lateral, turn]))
    observed, landmark, more = _read_observations(folder, prefix)
    with of_file(folder):
        odometry, steps, inside, outside = joined(odometry, observed[:, 0])
    observed, landmark = observed[inside], landmark[inside]
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
            observation=np.column_stack([observed[:, 2], wrap(observed[:, 3])]),
            observation_cov=diagonal_covariances(np.tile([range_sigma, bearing_sigma], (len(observed), 1))),
            landmark=landmark,
        )
    return Imported(recording, truth, (*notes, *more, *outside), unmatched=int(np.sum(~inside)))


def _prefix(folder: Path, robot: int | None) -> str:
    """Return the prefix of the names of the robot's files."""
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
    """Read a table whose first column is time; of several lines with the same time, the last is used."""
    lines, table = read_table(path, form)
    require_order(lines, table[:, 0], strict=False)
    last = np.diff(table[:, 0], append=np.inf) > 0.0
    return [lines[at] for at in np.flatnonzero(last)], table[last]


def _read_commands(path: Path, ground: Float | None) -> tuple[list[Line], Float, list[str]]:
    """Return lines, time, velocity and yaw rate (n, 3) from the first true pose on, and a note about dropped lines."""
    lines, commands = _in_time(path, "time velocity yaw-rate")
    begin = 0
    if ground is not None:
        known = ~np.isnan(interpolated(ground[:, 0], ground[:, 1:], commands[:, 0], MAX_GAP)[:, 0])
        if not known.any():
            raise UserError(f"{path}: no ground truth for any time in it; give files of one data set, or no truth")
        begin = int(np.argmax(known))
    if len(commands) < begin + 2:
        raise UserError(f"{path}: fewer than two stamps of odometry; give the whole log")
    notes = [f"{begin} lines of odometry are before the ground truth and are dropped"] if begin else []
    return lines[begin:], commands[begin:], notes


def _odometry(lines: list[Line], commands: Float, sigmas: Float) -> Odometry:
    """Return increments at velocities that are valid until the next line, with variances that grow with time."""
    seconds = np.diff(commands[:, 0])
    velocities = np.column_stack([commands[:-1, 1], np.zeros(len(seconds)), commands[:-1, 2]])
    increments = constant_twist(velocities, seconds)
    require_turns(lines, increments)
    return Odometry(commands[:, 0], increments, diagonal_covariances(sigmas * np.sqrt(seconds)[:, None]))


def _read_observations(folder: Path, prefix: str) -> tuple[Float, Int, list[str]]:
    """Return time, barcode, range and bearing (M, 4) of landmarks, their subjects (M,), and notes about others."""
    barcodes, _ = read_table(folder / "Barcodes.dat", "subject barcode")
    subject_of = {line.id_at(1): line.id_at(0) for line in barcodes}
    lines, observed = read_table(folder / f"{prefix}Measurement.dat", "time barcode range bearing")
    require_order(lines, observed[:, 0], strict=False)
    require_ranges(lines, observed[:, 2])
    require_bearings(lines, observed[:, 3])
    subjects = np.array([subject_of.get(line.id_at(1), -1) for line in lines], dtype=np.int64)
    dropped: dict[str, Marks] = {
        "are of other robots": (subjects >= 1) & (subjects <= ROBOTS),
        "have a barcode that is not in Barcodes.dat": subjects == -1,
    }
    notes = [f"{np.sum(marks)} observations {why} and are dropped" for why, marks in dropped.items() if marks.any()]
    kept = ~np.logical_or.reduce([*dropped.values()])
    return observed[kept], subjects[kept], notes


def _truth(path: Path, poses: Float | None, landmark: Int) -> Truth | None:
    """Return the truth of the path and, in the same frame, of the landmarks; None without a path."""
    if poses is None or not path.exists():
        return None if poses is None else Truth(poses=poses, association=landmark)
    lines, table = read_table(path, "subject x y x-sigma y-sigma")
    ids = np.array([line.id_at(0) for line in lines], dtype=np.int64)
    with of_file(path):
        return Truth(poses=poses, landmark_ids=ids, landmarks=table[:, 1:3], association=landmark)
