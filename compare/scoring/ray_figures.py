"""Figures of the rays of a bearing-only estimate, compared with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields

import numpy as np

from slamgauge.arrays import Float, Marks
from slamgauge.compare.scoring.intervals import mean
from slamgauge.compare.scoring.measured import Measured
from slamgauge.compare.scoring.runs import Others, Runs
from slamgauge.estimate import RayLog
from slamgauge.truth import NOBODY

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


def ray_figures(found: Measured) -> RayFigures | None:
    """Return the counts of an estimate; None without rays."""
    rays, truth = found.estimate.rays, found.truth
    if rays is None:
        return None
    collapsed, ended = rays.survivor >= 0, rays.end >= 0
    wrong, off = None, None
    if truth.poses is not None and truth.landmark_ids is not None:
        is_off = np.isin(rays.landmark, found.estimate.landmark_ids[found.map_nees > FAR_OFF])
        wrong = float(np.sum(collapsed & (is_off | ~_nearest_survived(found, truth.poses, rays))))
        off = float(np.sum(collapsed & is_off))
    return RayFigures(
        members=float(rays.members.mean()),
        collapsed=float(collapsed.sum()),
        wrong=wrong,
        off=off,
        lost=float((ended & ~collapsed).sum()),
        left=float((~ended).sum()),
    )


def _nearest_survived(found: Measured, poses: Float, rays: RayLog) -> Marks:
    """Return whether each ray's survivor was at birth the member nearest to the true distance; True if unknown."""
    if not len(rays.birth):  # without observations, rays have no members
        return np.zeros(0, dtype=np.bool_)
    owners = dict(zip(found.estimate.landmark_ids.tolist(), found.true_ids.tolist(), strict=True))
    owner = np.array([owners.get(name, NOBODY) for name in rays.landmark.tolist()])
    true = np.hypot(*found.from_truth(owner, poses[rays.birth, :2]).T)
    gaps = np.abs(rays.distances - true[:, None])
    return np.isnan(gaps).all(axis=1) | (np.nan_to_num(gaps, nan=np.inf).argmin(axis=1) == rays.survivor)


def describe(figures: RayFigures) -> str:
    """Return the counts of one run, or means over runs, in a sentence."""
    judged = "" if figures.wrong is None else f" ({figures.wrong:.3g} wrongly, {figures.off:.3g} end off by 3 sigma)"
    rest = f"{figures.lost:.3g} were lost, {figures.left:.3g} are left; {figures.members:.3g} members in the state"
    return f"{figures.collapsed:.4g} rays became points{judged}, {rest}"


def mean_figures(runs: Sequence[RayFigures | None]) -> RayFigures | None:
    """Return means over the runs that have each count; None without rays."""
    known = [astuple(each) for each in runs if each is not None]
    return RayFigures(*map(mean, np.array(known, dtype=np.float64).T)) if known else None


def mean_rays(runs: Runs, _: Others) -> RayFigures | None:
    """Return means over the runs of a study; None without rays."""
    rows = np.array([runs.figures[f"rays_{name}"] for name in RAY_FIGURES]).T
    return mean_figures([RayFigures(*row) for row in rows if not np.isnan(row[0])])
