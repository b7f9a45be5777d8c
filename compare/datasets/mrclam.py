"""One robot's log of the UTIAS Multi-Robot Cooperative Localization and Mapping data (Leung et al., IJRR 30(8), 2011).

    Odometry.dat               time [s], forward velocity [m/s], yaw rate [rad/s]: valid until the next line
    Measurement.dat            time [s], barcode, range [m], bearing [rad]
    Barcodes.dat               subject, barcode
    Groundtruth.dat            time [s], x [m], y [m], heading [rad]; may be missing
    Landmark_Groundtruth.dat   subject, x [m], y [m], two standard deviations; used only with Groundtruth.dat

Odometry, Measurement and Groundtruth may have the robot's prefix, as in the archive: `Robot1_Odometry.dat`. Subjects 1
to 5 are robots, not landmarks. With ground truth the log begins at the first odometry that has a true pose, and the
start is known exactly; else it begins at the origin.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.imported_log import (
    Imported,
    Log,
    Observed,
    checked,
    require_order,
    require_sigmas,
    with_sigmas,
)
from slamgauge.compare.datasets.synchronisation import Odometry
from slamgauge.compare.storage.text_lines import Line, read_table
from slamgauge.compare.storage.trajectories import Trajectory, interpolated
from slamgauge.errors import UserError
from slamgauge.se2 import exp

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

    The parameters are those of `slamgauge import mrclam`. The files do not contain the noise: standard deviations of
    the motion in one second [m, m, rad], whose variances grow with time, and of the sensor [m, rad] are guesses.

    Raises:
        UserError: With the file, the line and the remedy.
    """
    require_sigmas(forward=forward, lateral=lateral, turn=turn, range_sigma=range_sigma, bearing_sigma=bearing_sigma)
    found = sorted(folder.glob("*Odometry.dat" if robot is None else f"Robot{robot}_Odometry.dat"))
    if len(found) != 1:
        names = ", ".join(path.name for path in found)
        what = f"logs of several robots ({names})" if found else "no Odometry.dat of the robot in it"
        raise UserError(f"{folder}: {what}; give the folder of an MRCLAM data set, and choose a robot with --robot")
    prefix, notes = found[0].name.removesuffix("Odometry.dat"), list[str]()
    truth, path, true_map, begin = folder / f"{prefix}Groundtruth.dat", None, None, 0
    lines, commands = _in_time(found[0], "time velocity yaw-rate")
    if truth.exists():
        _, ground = _in_time(truth, "time x y heading")
        path = Trajectory(str(truth), ground[:, 0], ground[:, 1:])
        known = ~np.isnan(interpolated(path.stamps, path.poses, commands[:, 0], MAX_GAP)[:, 0])
        if not known.any():
            raise UserError(f"{truth}: no pose for any time of the odometry; give files of one data set, or no truth")
        begin = int(np.argmax(known))
        places = folder / "Landmark_Groundtruth.dat"
        if places.exists():
            rows, table = read_table(places, "subject x y x-sigma y-sigma")
            true_map = places, [line.id_at(0) for line in rows], table[:, 1:3]
    if len(commands) < begin + 2:
        raise UserError(f"{found[0]}: fewer than two stamps of odometry; give the whole log")
    if begin:
        notes.append(f"{begin} lines of odometry are before the ground truth and are dropped")
    stamps, speeds, rates = commands[begin:].T
    seconds = np.diff(stamps)
    twists = np.column_stack([speeds[:-1], np.zeros(len(seconds)), rates[:-1]])
    covs = with_sigmas(np.zeros((len(seconds), 3, 3)), [each * np.sqrt(seconds) for each in (forward, lateral, turn)])
    seen = _read_observations(folder, prefix, notes)
    seen = seen._replace(covs=with_sigmas(seen.covs, [range_sigma, bearing_sigma]))
    odometry = Odometry(stamps, exp(twists * seconds[:, None]), covs, lines[begin:])
    log = Log(where=folder, odometry=odometry, seen=seen, path=path, max_gap=MAX_GAP, map=true_map, notes=notes)
    return log.imported()


def _in_time(path: Path, form: str) -> tuple[list[Line], Float]:
    """Read a table whose first column is time; of several lines with the same time, the last is used."""
    lines, table = read_table(path, form)
    require_order(lines, table[:, 0], strict=False)
    last = np.diff(table[:, 0], append=np.inf) > 0.0
    return [lines[at] for at in np.flatnonzero(last)], table[last]


def _read_observations(folder: Path, prefix: str, notes: list[str]) -> Observed:
    """Read the observations of landmarks, without their noise, and add notes about others."""
    barcodes, _ = read_table(folder / "Barcodes.dat", "subject barcode")
    subject_of = {line.id_at(1): line.id_at(0) for line in barcodes}
    lines, table = read_table(folder / f"{prefix}Measurement.dat", "time barcode range bearing")
    require_order(lines, table[:, 0], strict=False)
    values = checked("range-bearing", lines, table[:, 2:])
    subjects = np.array([subject_of.get(line.id_at(1), -1) for line in lines], dtype=np.int64)
    kept = subjects > ROBOTS
    for count, why in (
        (np.sum((subjects >= 1) & ~kept), "are of other robots"),
        (np.sum(subjects < 1), "have a barcode that is not in Barcodes.dat"),
    ):
        notes += [f"{count} observations {why} and are dropped"] if count else []
    return Observed(
        "range-bearing", table[kept, 0], subjects[kept].tolist(), values[kept], np.zeros((kept.sum(), 2, 2))
    )
