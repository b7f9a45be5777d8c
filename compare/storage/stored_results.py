"""Read stored results: the folder of a run, and estimates in npz, CSV (see `csv_folder`) or TUM files.

A CSV file may have a column `stamp` [s] instead of `step`; then it needs no row for each step.

A TUM file has lines `t x y z qx qy qz qw`. The upper triangle of a covariance may follow: 6 numbers for (x, y,
heading), or 21 for (x, y, z, roll, pitch, yaw). Only the planar parts are used. `at_steps` has the rule for stamps.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Marks
from slamgauge.compare.storage.covariance_columns import from_triangles
from slamgauge.compare.storage.csv_folder import POSE, POSE_COV, read_estimate_csv
from slamgauge.compare.storage.files import (
    load_estimate,
    load_recording,
    load_truth,
    read_json,
)
from slamgauge.compare.storage.interpolation import interpolated, interpolated_covs
from slamgauge.compare.storage.path_doubts import path_doubts
from slamgauge.compare.storage.safe_names import shown
from slamgauge.compare.storage.spatial_poses import planar_covariances, planar_poses
from slamgauge.compare.storage.text_lines import csv_lines, read_lines, read_whole, rows_below
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.notices import tell_once
from slamgauge.recording import Recording
from slamgauge.truth import Truth, require_same_run

FEW_OWN = 0.5  # share of the poses of a file that must be at stamps of steps
MATCH, MAX_GAP = 1e-3, 1.0  # s: see `at_steps`
UNIT, TILTED = 1e-3, 0.1  # largest error of a quaternion's length, and qx or qy of a robot that stands level
WORDS = {"time": "stamp", "timestamp": "stamp", "t": "stamp", "heading": "theta", "yaw": "theta"}
TUM = 8  # columns without covariances
TRIANGLES = (6, 21)  # numbers of values in the triangle of a covariance of x, y, heading, or of a pose in space


class Results(NamedTuple):
    """Results of `slamgauge run` or `evaluate --out`; estimates by name, in the order of the command."""

    title: str
    truth: Truth | None
    recording: Recording
    estimates: dict[str, Estimate]


def load_results(folder: Path) -> Results:
    """Read the results in a folder.

    Raises:
        UserError: If the folder has no results, or its files belong to different runs.
    """
    path = folder / "metrics.json"
    if not path.is_file():
        raise UserError(
            f"{folder}: not a folder of results, it has no metrics.json; "
            "give one that `slamgauge run` or `slamgauge evaluate --out` has written"
        )
    metrics = read_json(path, "run")
    try:
        names, scenario, seed = list(metrics["estimators"]), metrics["scenario"], metrics["seed"]
    except (TypeError, KeyError):
        raise UserError(f"{path}: not what `slamgauge run` writes; run it again") from None
    if not names:
        raise UserError(f"{path}: contains no estimators; run the command again with at least one")
    recording = load_recording(folder / "recording.npz")
    truth = load_truth(folder / "truth.npz", recording) if (folder / "truth.npz").exists() else None
    require_same_run(truth, recording)
    estimates = {name: load_estimate(folder / "estimates" / f"{name}.npz", recording) for name in names}
    for name, estimate in estimates.items():
        if len(estimate.poses) != recording.steps + 1:
            raise UserError(
                f"{folder / 'estimates' / name}.npz: {len(estimate.poses)} poses, "
                f"but the recording in this folder needs {recording.steps + 1}; run the command again"
            )
    title = shown(folder.resolve().name if scenario is None else f"{scenario}, seed {seed}")
    return Results(title, truth, recording, estimates)


def load_stored(path: Path, recording: Recording) -> Estimate:
    """Read an estimate of `recording` from a file; estimates in CSV or TUM files count as filtered.

    Doubts about units, signs and frames of their paths are printed.

    Raises:
        UserError: If the file is missing or does not fit the recording; the message names the line.
    """
    if path.suffix == ".npz":
        return load_estimate(path)
    estimate = _read_csv(path, recording) if path.suffix == ".csv" else _read_tum(path, recording.stamps)
    tell_doubts(str(path), estimate, recording)
    return estimate


def own_steps(path: Path, recording: Recording) -> Marks | None:
    """Return the steps (N+1,) at whose stamp a trajectory in a TUM file has a pose of its own.

    Poses of all other steps are interpolated on straight lines, so only those of their own are compared with the truth.
    None if the file is of another form, or has a pose at every step or at hardly any.
    """
    if path.suffix in (".npz", ".csv"):
        return None
    stamps = np.sort(_tum_table(path)[:, 0])
    after = np.clip(np.searchsorted(stamps, recording.stamps), 1, max(len(stamps) - 1, 1))
    near = np.minimum(np.abs(stamps[after - 1] - recording.stamps), np.abs(stamps[after] - recording.stamps))
    own = near <= MATCH
    if own.all() or own.sum() < FEW_OWN * len(stamps):
        return None
    tell_once(f"{path}: has poses at {own.sum()} of {len(own)} steps; only these are compared with the truth")
    return own


def _read_csv(path: Path, recording: Recording) -> Estimate:
    """Read an estimate whose rows have stamps, or steps (see `read_estimate_csv`)."""
    lines = csv_lines(path, read_whole(path))
    header = [WORDS.get(word, word) for word in lines[0].words] if lines else []
    if header[:1] != ["stamp"]:
        return read_estimate_csv(path, "filtered", recording.steps)
    ours = replace(lines[0], words=header)
    rows = rows_below(path, [ours, *lines[1:]], ("stamp", *POSE), ("stamp", *POSE, *POSE_COV))
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    covs = from_triangles(rows[:, 4:], 3) if rows.shape[1] > 4 else None
    return at_steps(str(path), rows[:, 0], rows[:, 1:4], covs, recording.stamps)


def tell_doubts(where: str, estimate: Estimate, recording: Recording) -> None:
    """Print what the path of an estimate contradicts, see `path_doubts`."""
    for doubt in path_doubts(estimate.poses, recording):
        tell_once(f"{where}: its path {doubt}")


def _read_tum(path: Path, stamps: Float) -> Estimate:
    table = _tum_table(path)
    table = table[np.argsort(table[:, 0], kind="stable")]
    _require_headings(path, table[:, 4:TUM])
    covs = _covariances(table[:, TUM:]) if table.shape[1] > TUM else None
    return at_steps(str(path), table[:, 0], planar_poses(table[:, 1:TUM]), covs, stamps)


def _tum_table(path: Path) -> Float:
    """Return the numbers (n, columns) of a TUM file."""
    lines = read_lines(path, separator=",")
    for line in lines:
        if len(line.words) - TUM not in (0, *TRIANGLES):
            counts = ", ".join(str(TUM + more) for more in (0, *TRIANGLES))
            raise line.refused(f"{len(line.words)} columns", f"write {counts} numbers, t x y z qx qy qz qw first")
    if len({len(line.words) for line in lines}) > 1:
        raise UserError(f"{path}: lines have different numbers of columns; write all with, or all without covariances")
    return np.array([line.numbers() for line in lines]).reshape(len(lines), -1 if lines else TUM)


def at_steps(where: str, stamps: Float, poses: Float, covs: Float | None, steps: Float) -> Estimate:
    """Return the filtered estimate of a recording from poses with stamps of their own.

    A pose within `MATCH` [s] of a step, or half a step if that is shorter, is the pose of the step. Otherwise the poses
    on both sides, at most `MAX_GAP` [s] apart, are interpolated, and their covariances too. Before the first and after
    the last pose, the nearest one is used for half a step.

    Args:
        where: file or topic, for messages.
        stamps: (n,) [s], sorted; of several poses with the same stamp the first is used.
        poses: (n, 3).
        covs: (n, 3, 3), or None.
        steps: (N+1,) stamps of the recording [s].

    Raises:
        UserError: a step has no pose.
    """
    first = np.diff(stamps, prepend=-np.inf) > 0.0
    others = int(np.sum(~first[1:] & (np.diff(poses, axis=0) != 0.0).any(axis=1)))
    if others:
        what = f"{others} poses have the stamp of the pose before, and another position or heading"
        tell_once(f"{where}: {what}; only the first of each stamp is used: write stamps with all digits")
    stamps, poses, covs = stamps[first], poses[first], None if covs is None else covs[first]
    half = 0.5 * float(np.diff(steps).min(initial=1.0))
    times = steps
    if len(stamps):
        near = stamps[np.clip(np.searchsorted(stamps, steps - min(MATCH, half)), 0, len(stamps) - 1)]
        outside = np.clip(steps, stamps[0], stamps[-1])
        times = np.where(np.abs(outside - steps) <= half, outside, steps)
        times = np.where(np.abs(near - steps) <= min(MATCH, half), near, times)
        found = interpolated(stamps, poses, times, MAX_GAP)
    else:
        found = np.full((len(steps), 3), np.nan)
    if np.isnan(found).any():
        step = int(np.argmax(np.isnan(found).any(axis=1)))
        span = f", the poses are from {stamps[0]:.6f} to {stamps[-1]:.6f} s" if len(stamps) else ""
        what = f"no pose for step {step} at t = {steps[step]:.6f} s{span}"
        raise UserError(f"{where}: {what}; give poses from the first step to the last, at most {MAX_GAP:g} s apart")
    try:
        return Estimate("filtered", found, None if covs is None else interpolated_covs(stamps, covs, times))
    except UserError as error:
        raise UserError(f"{where}: {error}") from None


def _require_headings(path: Path, quaternions: Float) -> None:
    """Refuse quaternions (n, 4) in x, y, z, w that are not of unit length, and warn of tilted poses."""
    norms = np.linalg.norm(quaternions, axis=1)
    wrong = np.abs(norms - 1.0) > UNIT
    if wrong.any():
        step = int(wrong.argmax())
        what = f"pose {step}: the quaternion qx qy qz qw has the length {norms[step]:.4g}"
        raise UserError(f"{path}: {what}; write unit quaternions, 0 0 sin(heading/2) cos(heading/2) in the plane")
    tilts = np.abs(quaternions[:, :2]).max(axis=1)
    if tilts.max(initial=0.0) > TILTED:
        step = int(tilts.argmax())
        tell_once(
            f"{path}: qx or qy is {tilts[step]:.2f} at pose {step}: the robot is tilted, or the columns are not in the "
            "order qx qy qz qw; only the heading is used"
        )


def _covariances(triangles: Float) -> Float:
    """Return the covariances (n, 3, 3) of x, y and heading from upper triangles (n, 6) or (n, 21)."""
    is_planar = triangles.shape[1] == TRIANGLES[0]
    return from_triangles(triangles, 3) if is_planar else planar_covariances(from_triangles(triangles, 6))
