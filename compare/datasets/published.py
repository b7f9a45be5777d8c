"""Published recordings: one robot's log of UTIAS (Leung et al., IJRR 30(8), 2011), and Lost in the Woods (AER1513).

Files of UTIAS, the Multi-Robot Cooperative Localization and Mapping data, in the folder of a robot:

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

import zlib
from io import BytesIO
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets import imported_log as logs
from slamgauge.compare.storage.files import DAMAGED, explained
from slamgauge.compare.storage.text_lines import Line, read_table
from slamgauge.compare.storage.trajectories import Trajectory, interpolated
from slamgauge.errors import UserError
from slamgauge.se2 import compose, exp, wrap
from slamgauge.validation import LARGEST

ROBOTS = 5
MAX_GAP = 1.0  # s: ground truth is not interpolated over longer gaps
COLUMNS = ("t", "v", "om", "x_true", "y_true", "th_true", "true_valid")
SCALARS = ("d", "r_var", "b_var", "v_var", "om_var")


def read_mrclam(
    folder: Path,
    *,
    robot: int | None = None,
    forward: float = 0.05,
    lateral: float = 0.01,
    turn: float = 0.05,
    range_sigma: float = 0.15,
    bearing_sigma: float = 0.05,
) -> logs.Imported:
    """Read the recording of one robot, `range-bearing` and with subjects as ids, and its ground truth.

    The parameters are those of `slamgauge import mrclam`. The files do not contain the noise: standard deviations of
    the motion in one second [m, m, rad], whose variances grow with time, and of the sensor [m, rad] are guesses.

    Raises:
        UserError: With the file, the line and the remedy.
    """
    logs.require_sigmas(forward=forward, lateral=lateral, turn=turn, range=range_sigma, bearing=bearing_sigma)
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
        notes += [f"{begin} rows of odometry before the first true pose are left out"] if begin else []
        places = folder / "Landmark_Groundtruth.dat"
        if places.exists():
            rows, table = read_table(places, "subject x y x-sigma y-sigma")
            true_map = places, [line.id_at(0) for line in rows], table[:, 1:3]
    if len(commands) < begin + 2:
        raise UserError(f"{found[0]}: fewer than two stamps of odometry; give the whole log")
    stamps, speeds, rates = commands[begin:].T
    seconds = np.diff(stamps)
    twists = np.column_stack([speeds[:-1], np.zeros(len(seconds)), rates[:-1]])
    sigmas = [each * np.sqrt(seconds) for each in (forward, lateral, turn)]
    covs = logs.with_sigmas(np.zeros((len(seconds), 3, 3)), sigmas)
    seen = _read_observations(folder, prefix, (range_sigma, bearing_sigma), notes)
    odometry = logs.Odometry(stamps, exp(twists * seconds[:, None]), covs, lines[begin:])
    log = logs.Log(where=folder, odometry=odometry, seen=seen, path=path, max_gap=MAX_GAP, map=true_map, notes=notes)
    return log.imported()


def _in_time(path: Path, form: str) -> tuple[list[Line], Float]:
    """Read a table whose first column is time; of several lines with the same time, the last is used."""
    lines, table = read_table(path, form)
    logs.require_order(lines, table[:, 0], strict=False)
    last = np.diff(table[:, 0], append=np.inf) > 0.0
    return [lines[at] for at in np.flatnonzero(last)], table[last]


def _read_observations(folder: Path, prefix: str, sigmas: tuple[float, float], notes: list[str]) -> logs.Observed:
    """Read the observations of landmarks, with standard deviations [m, rad], and add notes about others."""
    barcodes, _ = read_table(folder / "Barcodes.dat", "subject barcode")
    subject_of = {line.id_at(1): line.id_at(0) for line in barcodes}
    lines, table = read_table(folder / f"{prefix}Measurement.dat", "time barcode range bearing")
    logs.require_order(lines, table[:, 0], strict=False)
    values = logs.checked("range-bearing", lines, table[:, 2:])
    subjects = np.array([subject_of.get(line.id_at(1), -1) for line in lines], dtype=np.int64)
    kept = subjects > ROBOTS
    if not kept.all():
        notes.append(f"{np.sum(~kept)} observations of other robots or unknown barcodes are dropped")
    covs = logs.with_sigmas(np.zeros((kept.sum(), 2, 2)), sigmas)
    return logs.Observed("range-bearing", table[kept, 0], subjects[kept].tolist(), values[kept], covs)


def read_lost_in_the_woods(path: Path, *, max_range: float = 5.0, lateral_slip: float = 0.02) -> logs.Imported:
    """Read dataset2.mat and its ground truth, with the body frame at the laser, `d` m ahead of the robot's centre.

    The start is the true first pose, fixed. Association is known. Control k moves the robot from pose k-1 to pose k.
    Poses without valid ground truth are rows of NaN. Observations beyond `max_range` [m] are dropped. `lateral_slip` is
    the standard deviation of the sideways velocity at the robot's centre [m/s], which is not in the file.

    Raises:
        UserError: With the file, the field and the remedy.
    """
    logs.require_sigmas(lateral_slip=lateral_slip)
    fields = _read_fields(path)
    ahead, ranges, bearings = float(fields["d"].item()), fields["r"], fields["b"]
    stamps, speeds, rates, x, y, heading, valid = (fields[name][:, 0] for name in COLUMNS)
    true_poses = compose(np.column_stack([x, y, heading]), np.array([ahead, 0.0, 0.0]))
    seen_at, seen = np.nonzero((ranges > 0) & (ranges <= max_range))
    seconds = np.diff(stamps)
    turns = rates[1:] * seconds
    # the robot's centre moves by (v dt, slip dt, omega dt), and the sensor by d (cos dtheta - 1, sin dtheta) more
    way = speeds[1:] * seconds + ahead * (np.cos(turns) - 1.0)
    increments = np.column_stack([way, ahead * np.sin(turns), turns])
    jacobian = np.tile(np.eye(3), (len(seconds), 1, 1))  # derivatives by (v, slip, omega), divided by dt
    jacobian[:, 0, 2], jacobian[:, 1, 2] = -ahead * np.sin(turns), ahead * np.cos(turns)
    jacobian *= seconds[:, None, None]
    variances = np.array([fields["v_var"].item(), lateral_slip**2, fields["om_var"].item()])
    values = np.column_stack([ranges[seen_at, seen], wrap(bearings[seen_at, seen])])
    noise = np.tile(np.diag([fields["r_var"].item(), fields["b_var"].item()]), (len(seen), 1, 1))
    log = logs.Log(
        where=path,
        odometry=logs.Odometry(stamps, increments, np.einsum("nij,j,nkj->nik", jacobian, variances, jacobian)),
        seen=logs.Observed("range-bearing", seen_at.astype(np.float64), seen.tolist(), values, noise),
        has_steps=True,
        path=Trajectory("true_valid", stamps[valid != 0], true_poses[valid != 0]),
        max_gap=0.0,
        map=(path, range(len(fields["l"])), fields["l"]),
    )
    return log.imported()


def _read_fields(path: Path) -> dict[str, Float]:
    """Read columns (N+1, 1), tables (N+1, L) and (L, 2) and scalars (1, 1)."""
    from scipy.io import loadmat  # imported here because it is slow and only this format needs it
    from scipy.io.matlab import MatReadError

    with explained(path, "read"):
        content = path.read_bytes()
    rest = content[128:]  # behind the header; scipy may end Python at variables with wrong checksums, or with none
    try:
        while rest:
            size = 8 + int.from_bytes(rest[4:8], "little")
            zlib.decompress(rest[8:size])
            rest = rest[size:]
        raw = loadmat(BytesIO(content), variable_names=(*COLUMNS, *SCALARS, "r", "b", "l"))
        steps, landmarks = len(raw["t"]), len(raw["l"])
        shapes = dict.fromkeys(COLUMNS, (steps, 1)) | dict.fromkeys(SCALARS, (1, 1))
        shapes |= dict.fromkeys(("r", "b"), (steps, landmarks)) | {"l": (landmarks, 2)}
        fields = {name: np.asarray(raw[name]).astype(np.float64, casting="same_kind") for name in shapes}
    except (MatReadError, OSError, ArithmeticError, *DAMAGED) as error:
        what = " ".join(str(error).split())[:200]
        raise UserError(f"{path}: not a whole dataset2.mat of Lost in the Woods ({what}); copy it again") from None
    for name, shape in shapes.items():
        if fields[name].shape != shape or not (np.abs(fields[name]) < LARGEST).all():
            raise UserError(f"{path}: field {name} must be {shape} finite numbers; correct it")
    return fields
