"""The Lost in the Woods recording (University of Toronto, AER1513): a MATLAB file with ground truth."""

from __future__ import annotations

import zlib
from io import BytesIO
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.imported_log import Imported, Log, Observed, require_sigmas
from slamgauge.compare.datasets.synchronisation import Odometry
from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.trajectories import Trajectory
from slamgauge.errors import UserError
from slamgauge.se2 import compose, wrap
from slamgauge.validation import LARGEST

COLUMNS = ("t", "v", "om", "x_true", "y_true", "th_true", "true_valid")
SCALARS = ("d", "r_var", "b_var", "v_var", "om_var")
# errors of loadmat at damaged files
DAMAGED = (OSError, ValueError, TypeError, LookupError, ArithmeticError, NotImplementedError, MemoryError, zlib.error)


def read_lost_in_the_woods(path: Path, *, max_range: float = 5.0, lateral_slip: float = 0.02) -> Imported:
    """Read the recording and its ground truth, with the body frame at the laser, `d` m ahead of the robot's centre.

    The start is the true first pose, fixed. Association is known. Control k moves the robot from pose k-1 to pose k.
    Poses without valid ground truth are rows of NaN. Observations beyond `max_range` [m] are dropped. `lateral_slip` is
    the standard deviation of the sideways velocity at the robot's centre [m/s], which is not in the file.

    Raises:
        UserError: With the file, the field and the remedy.
    """
    require_sigmas(lateral_slip=lateral_slip)
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
    log = Log(
        where=path,
        odometry=Odometry(stamps, increments, np.einsum("nij,j,nkj->nik", jacobian, variances, jacobian)),
        seen=Observed("range-bearing", seen_at.astype(np.float64), seen.tolist(), values, noise),
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
    try:
        raw = loadmat(BytesIO(content), variable_names=(*COLUMNS, *SCALARS, "r", "b", "l"))
        steps, landmarks = len(raw["t"]), len(raw["l"])
        shapes = dict.fromkeys(COLUMNS, (steps, 1)) | dict.fromkeys(SCALARS, (1, 1))
        shapes |= dict.fromkeys(("r", "b"), (steps, landmarks)) | {"l": (landmarks, 2)}
        fields = {name: np.asarray(raw[name]) for name in shapes}
    except (MatReadError, *DAMAGED) as error:
        what = " ".join(str(error).split())[:200]
        raise UserError(f"{path}: not a whole dataset2.mat of Lost in the Woods ({what}); copy it again") from None
    for name, values in fields.items():
        is_real = values.dtype.kind in "biuf" and values.shape == shapes[name]
        if not (steps and is_real and (np.abs(values.astype(np.float64)) < LARGEST).all()):
            raise UserError(f"{path}: field {name} must be {shapes[name]} finite real numbers; correct it")
    return {name: values.astype(np.float64) for name, values in fields.items()}
