"""Figures of the rays of a bearing-only estimate, compared with the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, fields

import numpy as np

from slamgauge.arrays import Float, Marks
from slamgauge.compare.scoring.consistency import squared_mahalanobis
from slamgauge.compare.scoring.intervals import mean
from slamgauge.compare.scoring.landmark_identity import landmark_errors, true_landmarks
from slamgauge.compare.scoring.runs import Runs
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import NOBODY, Truth

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
        is_off, is_right = _judged(truth, truth.poses, recording, estimate)
        wrong, off = float(np.sum(collapsed & (is_off | ~is_right))), float(np.sum(collapsed & is_off))
    return RayFigures(
        members=float(rays.members.mean()),
        collapsed=float(collapsed.sum()),
        wrong=wrong,
        off=off,
        lost=float((ended & ~collapsed).sum()),
        left=float((~ended).sum()),
    )


def _judged(truth: Truth, poses: Float, recording: Recording, estimate: Estimate) -> tuple[Marks, Marks]:
    """Return of each ray whether its landmark is more than three sigma off, and whether the right member survived.

    The right member is the one that was nearest to the true distance at birth; any is if the truth is unknown.
    """
    rays, covs = estimate.rays, estimate.landmark_covs
    assert rays is not None
    known = truth.landmark_ids, truth.landmarks
    ids, landmarks = true_landmarks(truth, recording, estimate)
    far = np.zeros(len(ids), dtype=np.bool_)
    if covs is not None:
        far = squared_mahalanobis(landmark_errors(ids, landmarks, *known), covs) > FAR_OFF
    is_off = np.isin(rays.landmark, estimate.landmark_ids[far])
    if not len(rays.birth):  # without observations, rays have no members
        return is_off, is_off
    owners = dict(zip(estimate.landmark_ids.tolist(), ids.tolist(), strict=True))
    owner = np.array([owners.get(name, NOBODY) for name in rays.landmark.tolist()])
    gaps = np.abs(rays.distances - np.hypot(*landmark_errors(owner, poses[rays.birth, :2], *known).T)[:, None])
    nearest = np.nan_to_num(gaps, nan=np.inf).argmin(axis=1)
    return is_off, np.isnan(gaps).all(axis=1) | (nearest == rays.survivor)


def describe(figures: RayFigures) -> str:
    """Return the counts of one run, or means over runs, in a sentence."""
    judged = "" if figures.wrong is None else f" ({figures.wrong:.3g} wrongly, {figures.off:.3g} end off by 3 sigma)"
    rest = f"{figures.lost:.3g} were lost, {figures.left:.3g} are left; {figures.members:.3g} members in the state"
    return f"{figures.collapsed:.4g} rays became points{judged}, {rest}"


def mean_figures(runs: Sequence[RayFigures | None]) -> RayFigures | None:
    """Return means over the runs that have each count; None without rays."""
    known = [astuple(each) for each in runs if each is not None]
    return RayFigures(*map(mean, np.array(known, dtype=np.float64).T)) if known else None


def mean_rays(runs: Runs, _: Mapping[str, Runs]) -> RayFigures | None:
    """Return means over the runs of a study; None without rays."""
    rows = np.array([runs.figures[f"rays_{name}"] for name in RAY_FIGURES]).T
    return mean_figures([RayFigures(*row) for row in rows if not np.isnan(row[0])])
