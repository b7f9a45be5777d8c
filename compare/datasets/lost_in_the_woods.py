"""The Lost in the Woods recording (University of Toronto, AER1513): a MATLAB file with ground truth."""

from __future__ import annotations

import zlib
from io import BytesIO
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.imported_log import of_file, require_max_range, require_sigmas
from slamgauge.compare.storage.files import explained
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import compose, wrap
from slamgauge.truth import Truth
from slamgauge.validation import LARGEST

_COLUMNS = ("t", "v", "om", "x_true", "y_true", "th_true", "true_valid")
_SCALARS = ("d", "r_var", "b_var", "v_var", "om_var")
_TABLES = ("r", "b", "l")

# errors of loadmat at damaged files
DAMAGED = (OSError, ValueError, TypeError, LookupError, ArithmeticError, NotImplementedError, MemoryError, zlib.error)

Fields = dict[str, Float]


def read_lost_in_the_woods(
    path: str | Path, *, max_range: float = 5.0, lateral_slip: float = 0.02
) -> tuple[Recording, Truth]:
    """Read the recording and its ground truth, with the body frame at the laser, `d` m ahead of the robot's centre.

    The start is the true first pose, fixed. Association is known. Control k moves the robot from pose k-1 to pose k.
    Poses without valid ground truth are rows of NaN.

    Args:
        path: The MATLAB file (dataset2.mat).
        max_range: Observations of landmarks beyond this range [m] are dropped.
        lateral_slip: Standard deviation of the sideways velocity at the robot's centre [m/s], not in the file.

    Raises:
        UserError: With the file, the field and the remedy.
    """
    require_max_range(max_range)
    require_sigmas(lateral_slip=lateral_slip)
    fields = _read_fields(path)
    poses = _true_sensor_poses(fields)
    if np.isnan(poses[0]).any():
        raise UserError(f"{path}: true_valid: no ground truth at the first step; cut the file")
    seen_at, seen = np.nonzero((fields["r"] > 0) & (fields["r"] <= max_range))
    observation = np.column_stack([fields["r"][seen_at, seen], wrap(fields["b"][seen_at, seen])])
    odometry, odometry_cov = _sensor_increments(fields, lateral_slip)
    with of_file(Path(path)):
        truth = Truth(poses=poses, landmark_ids=np.arange(len(fields["l"])), landmarks=fields["l"], association=seen)
        recording = Recording(
            stamps=fields["t"],
            prior_mean=poses[0],
            prior_cov=np.zeros((3, 3)),
            odometry=odometry,
            odometry_cov=odometry_cov,
            sensor="range-bearing",
            observation_step=seen_at,
            observation=observation,
            observation_cov=np.tile(np.diag([fields["r_var"], fields["b_var"]]), (len(seen), 1, 1)),
            landmark=seen,
        )
    return recording, truth


def _true_sensor_poses(fields: Fields) -> Float:
    """Return true poses (N+1, 3) of the sensor; NaN where the ground truth is not valid."""
    robot = np.column_stack([fields["x_true"], fields["y_true"], fields["th_true"]])
    robot[fields["true_valid"] == 0] = np.nan
    return compose(robot, np.array([fields["d"], 0.0, 0.0]))


def _sensor_increments(fields: Fields, lateral_slip: float) -> tuple[Float, Float]:
    """Return increments (N, 3) of the sensor frame, and their covariances (N, 3, 3).

    The robot's centre moves by (v dt, slip dt, omega dt); a sensor at (d, 0) on it adds
    (d (cos dtheta - 1), d sin dtheta, 0).
    """
    dt, ahead = np.diff(fields["t"]), fields["d"]
    turn = fields["om"][1:] * dt
    sine, cosine = np.sin(turn), np.cos(turn)
    increments = np.column_stack([fields["v"][1:] * dt + ahead * (cosine - 1.0), ahead * sine, turn])

    jacobian = np.tile(np.eye(3), (len(dt), 1, 1))  # derivatives by (v, slip, omega), divided by dt
    jacobian[:, 0, 2] = -ahead * sine
    jacobian[:, 1, 2] = ahead * cosine
    jacobian *= dt[:, None, None]
    variances = np.array([fields["v_var"], lateral_slip**2, fields["om_var"]])
    return increments, np.einsum("nij,j,nkj->nik", jacobian, variances, jacobian)


def _read_fields(path: str | Path) -> Fields:
    """Read columns (N+1,), tables (N+1, L) and (L, 2) and scalars (); refuse missing, infinite and misshapen ones."""
    from scipy.io import loadmat  # imported here because it is slow and only this format needs it
    from scipy.io.matlab import MatReadError

    names = (*_COLUMNS, *_SCALARS, *_TABLES)
    with explained(path, "read"):
        content = Path(path).read_bytes()
    try:
        raw = loadmat(BytesIO(content), variable_names=names)
        fields = {name: np.asarray(raw[name]) for name in names}
    except (MatReadError, *DAMAGED) as error:
        what = " ".join(str(error).split())[:200]
        raise UserError(f"{path}: not a whole dataset2.mat of Lost in the Woods ({what}); copy it again") from None
    for name, values in fields.items():
        if values.dtype.kind not in "biuf":
            raise UserError(f"{path}: field {name} is not a matrix of real numbers; correct it")
        fields[name] = values.astype(np.float64)
    steps, landmarks = len(fields["t"]), len(fields["l"])
    shapes = dict.fromkeys(_COLUMNS, (steps, 1)) | dict.fromkeys(_SCALARS, (1, 1))
    shapes |= dict.fromkeys(("r", "b"), (steps, landmarks)) | {"l": (landmarks, 2)}
    for name, shape in shapes.items():
        if fields[name].shape != shape or not steps:
            raise UserError(f"{path}: field {name} has shape {fields[name].shape}, not {shape} with steps; correct it")
        if not (np.abs(fields[name]) < LARGEST).all():
            raise UserError(f"{path}: field {name} must have finite numbers; correct it")
    return fields | {name: fields[name][:, 0] for name in _COLUMNS} | {name: fields[name][0, 0] for name in _SCALARS}
