"""Figures of the rays of a bearing-only estimate, compared with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.scoring.consistency import squared_mahalanobis
from slamgauge.compare.scoring.landmark_identity import landmark_errors, true_landmarks
from slamgauge.compare.scoring.nan_stats import mean
from slamgauge.estimate import Estimate, RayLog
from slamgauge.recording import Recording
from slamgauge.truth import Truth

FAR_OFF = 9.0  # squared Mahalanobis distance of three sigma


@dataclass(frozen=True)
class RayFigures:
    """Counts of one run, or means over runs; None if unknown.

    Attributes:
        members: mean over the steps of the number of members in the state.
        collapsed: rays that became points.
        wrong: collapsed rays whose survivor was not the member nearest to the truth at the ray's birth, or whose
            landmark is more than three sigma off at the end.
        off: collapsed rays whose landmark is more than three sigma off at the end.
        lost: rays that were deleted.
        left: rays that are still rays at the end.
    """

    members: float | None
    collapsed: float | None
    wrong: float | None
    off: float | None
    lost: float | None
    left: float | None


RAY_FIGURES = tuple(each.name for each in fields(RayFigures))


def ray_figures(truth: Truth, recording: Recording, estimate: Estimate) -> RayFigures | None:
    """Return the counts of an estimate; None without rays."""
    rays = estimate.rays
    if rays is None:
        return None
    collapsed, ended = rays.survivor >= 0, rays.end >= 0
    wrong, off = None, None
    if truth.poses is not None and truth.landmark_ids is not None:
        ids, landmarks = true_landmarks(truth, recording, estimate)
        is_off = np.isin(rays.landmark, estimate.landmark_ids[_far_off(truth, estimate, ids, landmarks)])
        known = dict(zip(estimate.landmark_ids.tolist(), ids.tolist(), strict=True))
        owner = np.array([known.get(name, -1) for name in rays.landmark.tolist()], dtype=np.int64)
        wrong = float(np.sum(collapsed & (is_off | ~_nearest_survived(truth, truth.poses, rays, owner))))
        off = float(np.sum(collapsed & is_off))
    return RayFigures(
        members=float(rays.members.mean()),
        collapsed=float(collapsed.sum()),
        wrong=wrong,
        off=off,
        lost=float((ended & ~collapsed).sum()),
        left=float((~ended).sum()),
    )


def _far_off(truth: Truth, estimate: Estimate, ids: Int, landmarks: Float) -> Int:
    """Return the landmarks more than three sigma from the truth, without those of unknown truth."""
    if estimate.landmark_covs is None:
        return np.zeros(0, dtype=np.int64)
    errors = landmark_errors(ids, landmarks, truth.landmark_ids, truth.landmarks)
    return np.flatnonzero(squared_mahalanobis(errors, estimate.landmark_covs) > FAR_OFF)


def _nearest_survived(
    truth: Truth, poses: Float, rays: RayLog, owner: Int
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return whether each ray's survivor was at birth the member nearest to the true distance; True if unknown.

    `owner` has the true id of each ray's landmark, -1 if unknown.
    """
    if not len(rays.birth):  # without observations, rays have no members
        return np.zeros(0, dtype=np.bool_)
    offsets = landmark_errors(owner, poses[rays.birth, :2], truth.landmark_ids, truth.landmarks)
    gaps = np.abs(rays.distances - np.hypot(*offsets.T)[:, None])
    nearest = np.where(np.isnan(gaps).all(axis=1), rays.survivor, np.nan_to_num(gaps, nan=np.inf).argmin(axis=1))
    return nearest == rays.survivor


def describe(figures: RayFigures) -> str:
    """Return the counts of one run, or means over runs, in a sentence."""
    judged = "" if figures.wrong is None else f" ({figures.wrong:.3g} wrongly, {figures.off:.3g} end off by 3 sigma)"
    rest = f"{figures.lost:.3g} were lost, {figures.left:.3g} are left; {figures.members:.3g} members in the state"
    return f"{figures.collapsed:.4g} rays became points{judged}, {rest}"


def mean_figures(runs: Sequence[RayFigures | None]) -> RayFigures | None:
    """Return means over the runs that have each count; None without rays."""
    known = [each for each in runs if each is not None]
    if not known:
        return None
    return RayFigures(*map(mean, np.array([astuple(each) for each in known], dtype=np.float64).T))
