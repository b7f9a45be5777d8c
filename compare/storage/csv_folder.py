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

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.storage.covariance_columns import from_triangles, upper_triangles
from slamgauge.compare.storage.csv_cells import write_csv
from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.text_lines import csv_lines, read_whole, rows_below
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Kind
from slamgauge.notices import tell_once
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS, Sensor
from slamgauge.validation import as_ints

START, ODOMETRY, OBSERVATIONS = "start.csv", "odometry.csv", "observations.csv"
RECORDING_FILES = (START, ODOMETRY, OBSERVATIONS)
LANDMARKS = "landmarks.csv"  # in the folder of an estimate; in that of a log it contains true landmarks
LOG_FILES = (ODOMETRY, OBSERVATIONS, "recording.toml", "truth.csv")

POSE = ("x", "y", "theta")
POSE_COV = ("cov_xx", "cov_xy", "cov_xt", "cov_yy", "cov_yt", "cov_tt")
INCREMENT = ("dx", "dy", "dtheta")
POINT = ("x", "y")
POINT_COV = ("cov_xx", "cov_xy", "cov_yy")


def _observed(columns: tuple[str, ...]) -> tuple[str, ...]:
    """Return the columns of a sensor, then those of its covariance (upper triangle, named by first letters)."""
    return (*columns, *(f"cov_{one[0]}{other[0]}" for i, one in enumerate(columns) for other in columns[i:]))


OBSERVED: dict[Sensor, tuple[str, ...]] = {each.name: _observed(each.columns) for each in SENSORS.values()}


def write_recording_csv(folder: Path, recording: Recording) -> None:
    """Write the three files of a recording into an existing folder; raise `UserError` if a file cannot be written."""
    stamps = recording.stamps.tolist()
    prior = [stamps[0], *recording.prior_mean.tolist(), *upper_triangles(recording.prior_cov[None])[0].tolist()]
    motion = zip(stamps[1:], recording.odometry.tolist(), upper_triangles(recording.odometry_cov).tolist(), strict=True)
    ids = np.full(len(recording.observation), -1) if recording.landmark is None else recording.landmark
    seen = zip(
        recording.observation_step.tolist(),
        ids.tolist(),
        recording.observation.tolist(),
        upper_triangles(recording.observation_cov).tolist(),
        strict=True,
    )
    write_rows(folder / START, ("stamp", *POSE, *POSE_COV), [prior])
    write_rows(
        folder / ODOMETRY,
        ("step", "stamp", *INCREMENT, *POSE_COV),
        ([step, stamp, *move, *cov] for step, (stamp, move, cov) in enumerate(motion, 1)),
    )
    write_rows(
        folder / OBSERVATIONS,
        ("step", "landmark", *OBSERVED[recording.sensor]),
        ([step, name, *value, *cov] for step, name, value, cov in seen),
    )


def write_estimate_csv(path: Path, estimate: Estimate) -> None:
    """Write the poses of an estimate, and its map, if it has one, into landmarks.csv in the same folder.

    Raises:
        UserError: If a file cannot be written.
    """
    covs, map_covs = estimate.pose_covs, estimate.landmark_covs
    _write_numbered(path, ("step", *POSE), POSE_COV, np.arange(len(estimate.poses)), estimate.poses, covs)
    if len(estimate.landmarks):
        beside = path.with_name(LANDMARKS)
        _write_numbered(beside, ("landmark", *POINT), POINT_COV, estimate.landmark_ids, estimate.landmarks, map_covs)


def read_estimate_csv(path: Path, kind: Kind, steps: int) -> Estimate:
    """Read an estimate from a CSV file, and its map from landmarks.csv in the same folder if that is not a log's.

    Args:
        path: CSV file of the poses.
        kind: Kind of the estimate.
        steps: Number of steps N; the file has N+1 rows.

    Raises:
        UserError: If the file is missing or a row is wrong; the message names the line.
    """
    rows = _read(path, ("step", *POSE), POSE_COV)
    _require_steps(path, rows[: steps + 1, 0], first=0)
    if len(rows) != steps + 1:
        raise UserError(f"{path}: has {len(rows)} rows; write {steps + 1}, one for the start and one for each step")
    beside = path.with_name(LANDMARKS)
    has_map = beside.exists()
    if has_map and any(path.with_name(name).exists() for name in LOG_FILES):
        tell_once(f"{beside}: belongs to the log in its folder, so {path.name} has no map; move the estimate away")
        has_map = False
    landmarks = _read(beside, ("landmark", *POINT), POINT_COV) if has_map else np.zeros((0, 3))
    has_covs = landmarks.shape[1] > 3
    try:
        return Estimate(
            kind,
            poses=rows[:, 1:4],
            pose_covs=from_triangles(rows[:, 4:], 3) if rows.shape[1] > 4 else None,
            landmark_ids=as_ints("landmark", landmarks[:, 0], (None,)),
            landmarks=landmarks[:, 1:3],
            landmark_covs=from_triangles(landmarks[:, 3:], 2) if has_covs else None,
        )
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


def write_rows(path: Path, header: Sequence[str], rows: Iterable[Sequence[float]]) -> None:
    """Write a header and rows of numbers with all digits; raise `UserError` if the file cannot be written."""
    with explained(path, "written"), path.open("w", encoding="ascii", newline="") as file:
        write_csv(file, [header, *rows])


def _write_numbered(
    path: Path, names: tuple[str, ...], cov_names: tuple[str, ...], numbers: Int, values: Float, covs: Float | None
) -> None:
    """Write numbered values (n, d) and, if given, the upper triangles of their covariances (n, d, d)."""
    triangles = [list[float]()] * len(values) if covs is None else upper_triangles(covs).tolist()
    rows = zip(numbers.tolist(), values.tolist(), triangles, strict=True)
    header = names if covs is None else (*names, *cov_names)
    write_rows(path, header, ([number, *value, *triangle] for number, value, triangle in rows))


def _require_steps(path: Path, steps: Float, first: int) -> None:
    """Raise `UserError` if a column of steps (n,) does not count up from `first`."""
    wrong = np.flatnonzero(steps != np.arange(first, first + len(steps)))
    if len(wrong):
        at = wrong[0]
        raise UserError(f"{path}, line {at + 2}: step {steps[at]:g}, expected {at + first}; sort the rows by step")


def _read(path: Path, needed: tuple[str, ...], optional: tuple[str, ...]) -> Float:
    """Return the rows of a file whose header is `needed`, or `needed` and `optional`."""
    return rows_below(path, csv_lines(path, read_whole(path)), needed, needed + optional)
