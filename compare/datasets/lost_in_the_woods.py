"""The Lost in the Woods recording (University of Toronto, AER1513): a MATLAB file with ground truth."""

from __future__ import annotations

import zlib
from io import BytesIO
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.imported_log import of_file
from slamgauge.compare.storage.files import explained
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import compose, wrap
from slamgauge.truth import Truth
from slamgauge.validation import LARGEST

# errors of loadmat at damaged files
DAMAGED = (OSError, ValueError, TypeError, LookupError, ArithmeticError, NotImplementedError, MemoryError, zlib.error)


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
    fields = _read_fields(path)
    ahead, ranges = float(fields["d"].item()), fields["r"]
    robot = np.column_stack([fields["x_true"], fields["y_true"], fields["th_true"]])
    robot[fields["true_valid"][:, 0] == 0] = np.nan
    poses = compose(robot, np.array([ahead, 0.0, 0.0]))
    if np.isnan(poses[0]).any():
        raise UserError(f"{path}: true_valid: no ground truth at the first step; cut the file")
    seen_at, seen = np.nonzero((ranges > 0) & (ranges <= max_range))
    stamps, speeds, rates = (fields[name][:, 0] for name in ("t", "v", "om"))
    seconds = np.diff(stamps)
    turns = rates[1:] * seconds
    # the robot's centre moves by (v dt, slip dt, omega dt), and the sensor by d (cos dtheta - 1, sin dtheta) more
    way = speeds[1:] * seconds + ahead * (np.cos(turns) - 1.0)
    jacobian = np.tile(np.eye(3), (len(seconds), 1, 1))  # derivatives by (v, slip, omega), divided by dt
    jacobian[:, 0, 2], jacobian[:, 1, 2] = -ahead * np.sin(turns), ahead * np.cos(turns)
    jacobian *= seconds[:, None, None]
    variances = np.array([fields["v_var"].item(), lateral_slip**2, fields["om_var"].item()])
    with of_file(Path(path)):
        truth = Truth(poses=poses, landmark_ids=np.arange(len(fields["l"])), landmarks=fields["l"], association=seen)
        recording = Recording(
            stamps=stamps,
            prior_mean=poses[0],
            prior_cov=np.zeros((3, 3)),
            odometry=np.column_stack([way, ahead * np.sin(turns), turns]),
            odometry_cov=np.einsum("nij,j,nkj->nik", jacobian, variances, jacobian),
            sensor="range-bearing",
            observation_step=seen_at,
            observation=np.column_stack([ranges[seen_at, seen], wrap(fields["b"][seen_at, seen])]),
            observation_cov=np.diag([fields["r_var"].item(), fields["b_var"].item()]),
            landmark=seen,
        )
    return recording, truth


def _read_fields(path: str | Path) -> dict[str, Float]:
    """Read columns (N+1, 1), tables (N+1, L) and (L, 2) and scalars (1, 1)."""
    from scipy.io import loadmat  # imported here because it is slow and only this format needs it
    from scipy.io.matlab import MatReadError

    columns, scalars = (
        ("t", "v", "om", "x_true", "y_true", "th_true", "true_valid"),
        ("d", "r_var", "b_var", "v_var", "om_var"),
    )
    with explained(path, "read"):
        content = Path(path).read_bytes()
    try:
        raw = loadmat(BytesIO(content), variable_names=(*columns, *scalars, "r", "b", "l"))
        steps, landmarks = len(raw["t"]), len(raw["l"])
        shapes = dict.fromkeys(columns, (steps, 1)) | dict.fromkeys(scalars, (1, 1))
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
