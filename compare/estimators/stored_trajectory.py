"""Estimates stored in files: a trajectory with stamps keeps its own poses, and gets a pose at every step.

A trajectory is scored at its own stamps. Poses at the other steps follow the odometry from one pose to the next; they
are drawn and stored, but not scored.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.compare.datasets.path_doubts import path_doubts
from slamgauge.compare.storage.csv_folder import read_estimate_csv
from slamgauge.compare.storage.files import load_estimate
from slamgauge.compare.storage.trajectories import Trajectory, has_stamps, interpolated_covs, read_trajectory
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.notices import tell_once
from slamgauge.recording import Recording
from slamgauge.se2 import between, chain, compose, exp, log, wrap

MATCH = 1e-3  # s: a pose so near to a step is the pose of the step; files often have stamps of whole milliseconds
MAX_GAP = 1.0  # s: longest time without a pose


class OwnPoses(NamedTuple):
    """Poses of a trajectory at their own stamps, each in the row of the nearest step.

    Attributes:
        estimate: the poses (N+1, 3) as they are in the file; rows of steps without one are interpolated.
        stamps: (N+1,) [s]; NaN for a step without a pose.
    """

    estimate: Estimate
    stamps: Float

    @property
    def compared(self) -> Marks:
        """(N+1,) whether a step has a pose."""
        return ~np.isnan(self.stamps)


@dataclass(frozen=True)
class StoredEstimate:
    """An estimator that returns a stored estimate; `own` are its poses at their own stamps, None: at the steps."""

    estimate: Estimate
    own: OwnPoses | None = None

    def __call__(self, _recording: Recording, /) -> Estimate:
        """Return the estimate, for any recording."""
        return self.estimate

    def changed(self, change: Callable[[Estimate], Estimate]) -> StoredEstimate:
        """Return the stored estimate with a change of its poses or covariances."""
        own = None if self.own is None else self.own._replace(estimate=change(self.own.estimate))
        return StoredEstimate(change(self.estimate), own)


def load_stored(path: Path, recording: Recording, time_offset: float = 0.0, max_gap: float = MAX_GAP) -> StoredEstimate:
    """Read an estimate of a recording from a file, or from BAG:/TOPIC; all but npz files count as filtered.

    Doubts about units, signs and frames of its path are printed.

    Args:
        path: npz, CSV, TUM, or a bag, a colon and a topic.
        recording: its steps and odometry.
        time_offset: added to the stamps of poses [s].
        max_gap: longest time without a pose [s].

    Raises:
        UserError: the file is missing or does not fit the recording; the message names the line.
    """
    bag, colon, topic = str(path).partition(":/")
    if not colon and (path.suffix == ".npz" or not has_stamps(path)):
        if time_offset:
            raise UserError(f"{path}: has no stamps that --time-offset could change; leave it out")
        if path.suffix == ".npz":
            return StoredEstimate(load_estimate(path))
        found = StoredEstimate(read_estimate_csv(path, "filtered", recording.steps))
    else:
        trajectory = _read_bag(Path(bag), f"/{topic}") if colon else read_trajectory(path)
        found = stored_estimate(trajectory._replace(stamps=trajectory.stamps + time_offset), recording, max_gap)
    for doubt in path_doubts(found.estimate.poses, recording):
        tell_once(f"{path}: its path {doubt}")
    return found


def _read_bag(path: Path, topic: str) -> Trajectory:
    from slamgauge.compare.datasets.bag_log import read_bag_trajectory  # needs the extra `ros`

    return read_bag_trajectory(path, topic)


def stored_estimate(trajectory: Trajectory, recording: Recording, max_gap: float = MAX_GAP) -> StoredEstimate:
    """Return the filtered estimate of a recording that a trajectory is, and print how many of its poses are compared.

    Of several poses with the same stamp the first is used, and of several near a step the nearest.

    Args:
        trajectory: poses with stamps.
        recording: its steps and odometry.
        max_gap: longest time without a pose [s].

    Raises:
        UserError: a step is in a longer gap, or the poses are not valid.
    """
    where, steps = trajectory.where, recording.stamps
    found = _distinct(trajectory)
    _require_poses(found, steps, max_gap)
    rows = _nearest(steps, found.stamps)
    off = np.abs(found.stamps[rows] - steps)
    has_own = off <= _reach(steps)
    near = has_own & (off <= MATCH)
    at_steps = _along_odometry(found, recording)
    at_steps[near] = found.poses[rows[near]]
    poses = np.where(has_own[:, None], found.poses[rows], at_steps)
    covs, own_covs = None, None
    if found.covs is not None:
        covs = interpolated_covs(found.stamps, found.covs, steps)
        own_covs = np.where(has_own[:, None, None], found.covs[rows], covs)
    try:
        estimate = Estimate("filtered", at_steps, covs)
        if near.all():
            return StoredEstimate(estimate)
        own = OwnPoses(Estimate("filtered", poses, own_covs), np.where(has_own, found.stamps[rows], np.nan))
    except UserError as error:
        raise UserError(f"{where}: {error}") from None
    own.stamps[near] = steps[near]
    tell_once(f"{where}: {has_own.sum()} poses are compared, at their own stamps; the recording has {len(steps)} steps")
    return StoredEstimate(estimate, own)


def _distinct(trajectory: Trajectory) -> Trajectory:
    """Return the trajectory without poses that have the stamp of the pose before."""
    where, stamps, poses, covs = trajectory
    first = np.diff(stamps, prepend=-np.inf) > 0.0
    others = int(np.sum(~first[1:] & (np.diff(poses, axis=0) != 0.0).any(axis=1)))
    if others:
        what = f"{others} poses have the stamp of the pose before, and another position or heading"
        tell_once(f"{where}: {what}; only the first of each stamp is used: write stamps with all digits")
    return Trajectory(where, stamps[first], poses[first], None if covs is None else covs[first])


def _require_poses(trajectory: Trajectory, steps: Float, max_gap: float) -> None:
    """Refuse steps that are in a gap of the trajectory, or outside of it by more than `max_gap` [s]."""
    stamps = trajectory.stamps
    ends = np.concatenate([[-np.inf], stamps, [np.inf]])
    after = np.searchsorted(stamps, steps)  # in `ends`, the stamps before and after a step are at `after` and one on
    before, behind = steps - ends[after], ends[after + 1] - steps
    gap = np.where(np.isfinite(before + behind), before + behind, np.minimum(before, behind))
    missing = (gap > max_gap + MATCH) & (np.minimum(before, behind) > MATCH)
    if not missing.any():
        return
    step = int(np.argmax(missing))
    span = f", the poses are from {stamps[0]:.6f} to {stamps[-1]:.6f} s" if len(stamps) else ""
    is_outside = not np.isfinite(before[step] + behind[step])
    size = "; --time-offset S shifts them" if is_outside else f"; --max-gap {gap[step] + 0.05:.1f} accepts it"
    raise UserError(
        f"{trajectory.where}: no pose within {max_gap:g} s of step {step} at t = {steps[step]:.6f} s{span}; "
        f"give poses from the first step to the last, at most {max_gap:g} s apart{size}"
    )


def _nearest(steps: Float, stamps: Float) -> Int:
    """Return the row of the nearest of the sorted stamps (n,) for each step (N+1,)."""
    after = np.clip(np.searchsorted(stamps, steps), 1, max(len(stamps) - 1, 1))
    is_before = steps - stamps[after - 1] <= np.abs(stamps[np.minimum(after, len(stamps) - 1)] - steps)
    return np.where(is_before, after - 1, np.minimum(after, len(stamps) - 1))


def _reach(steps: Float) -> Float:
    """Return how far from each step (N+1,) its pose may be [s]: half of the way to the nearer neighbour."""
    ways = np.diff(steps)
    if not len(ways):
        return np.full(len(steps), MATCH)
    return 0.5 * np.minimum(np.append(ways, np.inf), np.append(np.inf, ways))


def _along_odometry(trajectory: Trajectory, recording: Recording) -> Float:
    """Return poses (N+1, 3) at the steps that follow the odometry from one pose of a trajectory to the next.

    The difference to the next pose is distributed over the time between both.
    """
    driven = chain(np.zeros(3), recording.odometry)
    at_own = _driven_at(driven, recording, trajectory.stamps)
    last = len(trajectory.stamps) - 1
    before = np.clip(np.searchsorted(trajectory.stamps, recording.stamps, side="right") - 1, 0, last)
    after = np.minimum(before + 1, last)
    begin = trajectory.poses[before]
    found = compose(begin, between(at_own[before], driven))
    rest = trajectory.poses[after] - compose(begin, between(at_own[before], at_own[after]))
    rest[:, 2] = wrap(rest[:, 2])
    way = trajectory.stamps[after] - trajectory.stamps[before]
    gone = (recording.stamps - trajectory.stamps[before]) / np.where(way > 0.0, way, 1.0)
    share = np.where(way > 0.0, gone, 0.0).clip(0.0, 1.0)
    return found + share[:, None] * rest


def _driven_at(driven: Float, recording: Recording, times: Float) -> Float:
    """Return the poses (n, 3) at times (n,) [s] of the path (N+1, 3) of the odometry alone."""
    steps = recording.stamps
    begin = np.clip(np.searchsorted(steps, times, side="right") - 1, 0, max(recording.steps - 1, 0))
    if not recording.steps:
        return driven[begin]
    share = np.clip((times - steps[begin]) / (steps[begin + 1] - steps[begin]), 0.0, 1.0)
    return compose(driven[begin], exp(share[:, None] * log(recording.odometry[begin])))
