"""Read and write recordings and estimates as CSV files, for programs in any language.

A recording is a folder of three files with headers. Headings are in radians; covariances are upper triangles.

    start.csv         stamp,x,y,theta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt           one row: the prior
    odometry.csv      step,stamp,dx,dy,dtheta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt   steps 1..N, body frame
    observations.csv  step,landmark,range,bearing,cov_rr,cov_rb,cov_bb                    steps 0..N, ordered by step

`stamp` [s] is the time at the end of the step. `landmark` is an id >= 0, or -1 in all rows if ids are unknown.
A bearing-only sensor has the columns `step,landmark,bearing,cov_bb`, a position sensor (body frame, [m])
`step,landmark,x,y,cov_xx,cov_xy,cov_yy`.

An estimate is one file with a row for each of the steps 0..N in order. A map may be in the same folder:

    estimate.csv      step,x,y,theta  or  step,x,y,theta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt
    landmarks.csv     landmark,x,y  or  landmark,x,y,cov_xx,cov_xy,cov_yy
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.storage.files import explained, write_csv
from slamgauge.compare.storage.text_lines import read_whole, rows_below
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Kind
from slamgauge.notices import tell_once
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS, Sensor
from slamgauge.validation import as_ints

START, ODOMETRY, OBSERVATIONS = "start.csv", "odometry.csv", "observations.csv"
LANDMARKS = "landmarks.csv"  # in the folder of an estimate; in that of a log it contains true landmarks
LOG_FILES = (ODOMETRY, OBSERVATIONS, "recording.toml", "truth.csv")

POSE = ("x", "y", "theta")
POSE_COV = ("cov_xx", "cov_xy", "cov_xt", "cov_yy", "cov_yt", "cov_tt")
INCREMENT = ("dx", "dy", "dtheta")
POINT = ("x", "y")
POINT_COV = ("cov_xx", "cov_xy", "cov_yy")

# columns of each sensor, then those of its covariance (upper triangle, named by first letters)
OBSERVED: dict[Sensor, tuple[str, ...]] = {
    each.name: (*each.columns, *(f"cov_{a[0]}{b[0]}" for i, a in enumerate(each.columns) for b in each.columns[i:]))
    for each in SENSORS.values()
}


def upper_triangles(matrices: Float) -> Float:
    """Return the upper triangles (n, d (d + 1) / 2), row by row, of matrices (n, d, d)."""
    rows, columns = np.triu_indices(matrices.shape[1])
    return matrices[:, rows, columns]


def from_triangles(triangles: Float, size: int) -> Float:
    """Return symmetric matrices (n, size, size) from their upper triangles (n, size (size + 1) / 2)."""
    rows, columns = np.triu_indices(size)
    matrices = np.empty((len(triangles), size, size))
    matrices[:, rows, columns] = triangles
    matrices[:, columns, rows] = triangles
    return matrices


def write_recording_csv(folder: Path, recording: Recording) -> None:
    """Write the three files of a recording into an existing folder; raise `UserError` if a file cannot be written."""
    stamps, steps = recording.stamps, np.arange(1, recording.steps + 1)
    ids = np.full(len(recording.observation), -1) if recording.landmark is None else recording.landmark
    start = stamps[:1], recording.prior_mean[None], upper_triangles(recording.prior_cov[None])
    moves = steps, stamps[1:], recording.odometry, upper_triangles(recording.odometry_cov)
    seen = recording.observation_step, ids, recording.observation, upper_triangles(recording.observation_cov)
    write_rows(folder / START, ("stamp", *POSE, *POSE_COV), *start)
    write_rows(folder / ODOMETRY, ("step", "stamp", *INCREMENT, *POSE_COV), *moves)
    write_rows(folder / OBSERVATIONS, ("step", "landmark", *OBSERVED[recording.sensor]), *seen)


def write_estimate_csv(path: Path, estimate: Estimate) -> None:
    """Write the poses of an estimate, and its map, if it has one, into landmarks.csv in the same folder.

    Raises:
        UserError: If a file cannot be written.
    """
    poses, covs = estimate.poses, estimate.pose_covs
    more, triangles = ((), []) if covs is None else (POSE_COV, [upper_triangles(covs)])
    write_rows(path, ("step", *POSE, *more), np.arange(len(poses)), poses, *triangles)
    if len(estimate.landmarks):
        covs = estimate.landmark_covs
        more, triangles = ((), []) if covs is None else (POINT_COV, [upper_triangles(covs)])
        header = ("landmark", *POINT, *more)
        write_rows(path.with_name(LANDMARKS), header, estimate.landmark_ids, estimate.landmarks, *triangles)


def read_estimate_csv(path: Path, kind: Kind, steps: int) -> Estimate:
    """Read an estimate from a CSV file, and its map from landmarks.csv in the same folder if that is not a log's.

    Args:
        path: CSV file of the poses.
        kind: Kind of the estimate.
        steps: Number of steps N; the file has N+1 rows.

    Raises:
        UserError: If the file is missing or a row is wrong; the message names the line.
    """
    rows = rows_below(path, read_whole(path), ("step", *POSE), ("step", *POSE, *POSE_COV))
    wrong = np.flatnonzero(rows[: steps + 1, 0] != np.arange(len(rows[: steps + 1])))
    if len(wrong):
        at = wrong[0]
        raise UserError(f"{path}, line {at + 2}: step {rows[at, 0]:g}, expected {at}; sort the rows by step")
    if len(rows) != steps + 1:
        raise UserError(f"{path}: has {len(rows)} rows; write {steps + 1}, one for the start and one for each step")
    beside = path.with_name(LANDMARKS)
    has_map = beside.exists()
    if has_map and any(path.with_name(name).exists() for name in LOG_FILES):
        tell_once(f"{beside}: belongs to the log in its folder, so {path.name} has no map; move the estimate away")
        has_map = False
    landmarks = np.zeros((0, 3))
    if has_map:
        landmarks = rows_below(beside, read_whole(beside), ("landmark", *POINT), ("landmark", *POINT, *POINT_COV))
    try:
        return Estimate(
            kind,
            poses=rows[:, 1:4],
            pose_covs=from_triangles(rows[:, 4:], 3) if rows.shape[1] > 4 else None,
            landmark_ids=as_ints("landmark", landmarks[:, 0], (None,)),
            landmarks=landmarks[:, 1:3],
            landmark_covs=from_triangles(landmarks[:, 3:], 2) if landmarks.shape[1] > 3 else None,
        )
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


def write_rows(path: Path, header: Sequence[str], *parts: Float | Int) -> None:
    """Write a header and columns of numbers with all digits; raise `UserError` if the file cannot be written.

    Args:
        path: The file.
        header: Names of the columns.
        parts: One column (n,), or several (n, k), each. Whole numbers are written without a point.
    """
    columns = [column for part in parts for column in np.atleast_2d(part.T).tolist()]
    with explained(path, "written"), path.open("w", encoding="ascii", newline="") as file:
        write_csv(file, [header, *zip(*columns, strict=True)])
