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

from slamgauge.arrays import Float, Marks
from slamgauge.compare.storage.csv_folder import read_estimate_csv
from slamgauge.compare.storage.files import load_estimate
from slamgauge.compare.storage.trajectories import (
    Trajectory,
    has_stamps,
    interpolated_covs,
    neighbours,
    read_trajectory,
)
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

    Doubts about units, signs and frames of its path are printed. `time_offset` [s] is added to the stamps of poses.
    `UserError`: the file is missing, has a wrong line, or leaves the recording without a pose for more than `max_gap`
    [s].
    """
    bag, colon, topic = str(path).partition(":/")
    if colon or (path.suffix != ".npz" and has_stamps(path)):
        if colon:
            from slamgauge.compare.datasets.bag_log import read_bag_trajectory  # needs the extra `ros`

            trajectory = read_bag_trajectory(Path(bag), f"/{topic}")
        else:
            trajectory = read_trajectory(path)
        found = stored_estimate(trajectory._replace(stamps=trajectory.stamps + time_offset), recording, max_gap)
    elif time_offset:
        raise UserError(f"{path}: has no stamps that --time-offset could change; leave it out")
    elif path.suffix == ".npz":
        return StoredEstimate(load_estimate(path))
    else:
        found = StoredEstimate(read_estimate_csv(path, "filtered", recording.steps))
    from slamgauge.compare.datasets.plausibility import path_doubts  # slow libraries

    for doubt in path_doubts(found.estimate.poses, recording):
        tell_once(f"{path}: its path {doubt}")
    return found


def stored_estimate(trajectory: Trajectory, recording: Recording, max_gap: float = MAX_GAP) -> StoredEstimate:
    """Return the filtered estimate of a recording that a trajectory is, and print how many of its poses are compared.

    Of several poses with the same stamp the first is used, and of several near a step the nearest. `UserError`: a step
    is in a gap of more than `max_gap` [s], or the poses are not valid.
    """
    found, steps = _distinct(trajectory), recording.stamps
    _require_poses(found, steps, max_gap)
    rows = np.searchsorted((found.stamps[1:] + found.stamps[:-1]) / 2, steps)  # the nearest poses
    off, ways = np.abs(found.stamps[rows] - steps), np.diff(steps)
    reach = 0.5 * np.minimum(np.append(ways, np.inf), np.append(np.inf, ways)) if len(ways) else MATCH
    has_own = off <= reach  # nearer than half of the way to the next step
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
        raise UserError(f"{found.where}: {error}") from None
    own.stamps[near] = steps[near]
    what = f"{has_own.sum()} poses are compared, at their own stamps; the recording has {len(steps)} steps"
    tell_once(f"{found.where}: {what}")
    return StoredEstimate(estimate, own)


def _distinct(trajectory: Trajectory) -> Trajectory:
    """Return the trajectory without poses that have the stamp of the pose before."""
    where, stamps, poses, covs = trajectory
    first = np.diff(stamps, prepend=-np.inf) > 0.0
    if others := int(np.sum(~first[1:] & (np.diff(poses, axis=0) != 0.0).any(axis=1))):
        what = f"{others} poses have the stamp of the pose before, and another position or heading"
        tell_once(f"{where}: {what}; only the first of each stamp is used: write stamps with all digits")
    return Trajectory(where, stamps[first], poses[first], None if covs is None else covs[first])


def _require_poses(trajectory: Trajectory, steps: Float, max_gap: float) -> None:
    """Refuse steps that are in a gap of the trajectory, or outside of it by more than `max_gap` [s]."""
    stamps = trajectory.stamps
    ends = np.concatenate([[-np.inf], stamps, [np.inf]])
    after = np.searchsorted(stamps, steps)  # in `ends`, the stamps before and after a step are at `after` and one on
    before, behind = steps - ends[after], ends[after + 1] - steps
    nearest = np.minimum(before, behind)
    gap = np.where(np.isfinite(before + behind), before + behind, nearest)
    missing = (gap > max_gap + MATCH) & (nearest > MATCH)
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


def _along_odometry(trajectory: Trajectory, recording: Recording) -> Float:
    """Return poses (N+1, 3) at the steps that follow the odometry from one pose of a trajectory to the next.

    The difference to the next pose is distributed over the time between both.
    """
    stamps, poses = trajectory.stamps, trajectory.poses
    driven = chain(np.zeros(3), recording.odometry)
    begin, _, share = neighbours(recording.stamps, stamps)
    motions = np.vstack([recording.odometry, np.zeros(3)])  # none after the last step
    at_own = compose(driven[begin], exp(share[:, None] * log(motions[begin])))
    before, after, share = neighbours(stamps, recording.stamps)
    rest = poses[after] - compose(poses[before], between(at_own[before], at_own[after]))
    rest[:, 2] = wrap(rest[:, 2])
    return compose(poses[before], between(at_own[before], driven)) + share[:, None] * rest
