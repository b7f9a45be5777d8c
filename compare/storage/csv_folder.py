"""Read and write recordings and estimates as CSV files, for programs in any language.

docs/your_filter.md has the files of a recording and of an estimate, with the columns and units of each. Covariances are
upper triangles, row by row. Landmarks are -1 in all rows of a recording without ids.
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


def from_triangles(triangles: Float) -> Float:
    """Return symmetric matrices (n, d, d) from their upper triangles (n, d (d + 1) / 2)."""
    size = int((2 * triangles.shape[1]) ** 0.5)
    rows, columns = np.triu_indices(size)
    matrices = np.empty((len(triangles), size, size))
    matrices[:, rows, columns] = triangles
    matrices[:, columns, rows] = triangles
    return matrices


def write_recording_csv(folder: Path, recording: Recording) -> None:
    """Write the three files of a recording into an existing folder."""
    stamps, steps = recording.stamps, np.arange(1, recording.steps + 1)
    ids = np.full(len(recording.observation), -1) if recording.landmark is None else recording.landmark
    start = stamps[:1], recording.prior_mean[None], upper_triangles(recording.prior_cov[None])
    moves = steps, stamps[1:], recording.odometry, upper_triangles(recording.odometry_cov)
    seen = recording.observation_step, ids, recording.observation, upper_triangles(recording.observation_cov)
    write_rows(folder / START, ("stamp", *POSE, *POSE_COV), *start)
    write_rows(folder / ODOMETRY, ("step", "stamp", "dx", "dy", "dtheta", *POSE_COV), *moves)
    write_rows(folder / OBSERVATIONS, ("step", "landmark", *OBSERVED[recording.sensor]), *seen)


def write_estimate_csv(path: Path, estimate: Estimate) -> None:
    """Write the poses of an estimate, and its map, if it has one, into landmarks.csv in the same folder."""
    poses, covs = estimate.poses, estimate.pose_covs
    more, triangles = ((), []) if covs is None else (POSE_COV, [upper_triangles(covs)])
    write_rows(path, ("step", *POSE, *more), np.arange(len(poses)), poses, *triangles)
    if len(estimate.landmarks):
        covs = estimate.landmark_covs
        more, triangles = ((), []) if covs is None else (POINT_COV, [upper_triangles(covs)])
        header = ("landmark", *POINT, *more)
        write_rows(path.with_name(LANDMARKS), header, estimate.landmark_ids, estimate.landmarks, *triangles)


def read_estimate_csv(path: Path, kind: Kind, steps: int) -> Estimate:
    """Read an estimate of N `steps` from a CSV file, and its map from landmarks.csv beside it if no log is there."""
    rows = rows_below(path, read_whole(path), ("step", *POSE), ("step", *POSE, *POSE_COV))
    for at in np.flatnonzero(rows[: steps + 1, 0] != np.arange(len(rows[: steps + 1])))[:1]:
        raise UserError(f"{path}, line {at + 2}: step {rows[at, 0]:g}, expected {at}; sort the rows by step")
    if len(rows) != steps + 1:
        raise UserError(f"{path}: has {len(rows)} rows; write {steps + 1}, one for the start and one for each step")
    beside, landmarks = path.with_name(LANDMARKS), np.zeros((0, 3))
    if beside.exists() and any(path.with_name(name).exists() for name in LOG_FILES):
        tell_once(f"{beside}: belongs to the log in its folder, so {path.name} has no map; move the estimate away")
    elif beside.exists():
        landmarks = rows_below(beside, read_whole(beside), ("landmark", *POINT), ("landmark", *POINT, *POINT_COV))
    try:
        return Estimate(
            kind,
            poses=rows[:, 1:4],
            pose_covs=from_triangles(rows[:, 4:]) if rows.shape[1] > 4 else None,
            landmark_ids=as_ints("landmark", landmarks[:, 0], (None,)),
            landmarks=landmarks[:, 1:3],
            landmark_covs=from_triangles(landmarks[:, 3:]) if landmarks.shape[1] > 3 else None,
        )
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


def write_rows(path: Path, header: Sequence[str], *parts: Float | Int) -> None:
    """Write a header and columns (n,) or (n, k) of numbers with all digits; whole numbers have no point."""
    columns = [column for part in parts for column in np.atleast_2d(part.T).tolist()]
    with explained(path, "written"), path.open("w", encoding="ascii", newline="") as file:
        write_csv(file, [header, *zip(*columns, strict=True)])
