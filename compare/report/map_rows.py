"""Encode the maps of an estimate for a replay: one for each frame, or the final map."""

from __future__ import annotations

from typing import Any

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.figures.map_contents import first_seen, map_at
from slamgauge.compare.report.array_encoding import pack
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

FULL_WEIGHT = 255  # byte for weight 1


def packed_map(recording: Recording, estimate: Estimate, shown: Int) -> dict[str, Any] | None:
    """Return the maps at the shown steps; None without a map."""
    history = estimate.history
    if history is not None and len(history.step):
        return _history(estimate, shown)
    return _last(recording, estimate, shown) if len(estimate.landmark_ids) else None


def _history(estimate: Estimate, shown: Int) -> dict[str, Any]:
    """Return a map for each frame with a new record of the map since the previous frame."""
    history, log = estimate.history, estimate.rays
    assert history is not None
    changes = np.searchsorted(history.step, shown, side="right")
    if log is not None:  # lost rays leave the map between two records
        changes = changes + np.searchsorted(np.sort(log.end[log.end >= 0]), shown, side="right")
    frames = np.flatnonzero(np.diff(changes, prepend=0) > 0)
    maps = [map_at(estimate, int(shown[frame])) for frame in frames]
    covs = np.concatenate([each.cov for each in maps]) if maps else np.zeros((0, 2, 2))
    return {
        "mapAt": pack(np.searchsorted(frames, np.arange(len(shown)), side="right") - 1, "i4"),
        "start": pack(np.concatenate([[0], np.cumsum([len(each.landmark) for each in maps])]), "i4"),
        "landmark": pack(np.concatenate([each.landmark for each in maps]), "i4"),
        "member": pack(np.concatenate([each.member for each in maps]) + 1, "u1"),
        "weight": pack(np.concatenate([each.weight for each in maps]) * FULL_WEIGHT, "u1"),
        "place": pack(np.concatenate([each.position for each in maps])),
        "cov": pack(triangle(covs)),
        "since": None,
        "isHistory": True,
    }


def _last(recording: Recording, estimate: Estimate, shown: Int) -> dict[str, Any]:
    """Return the final map; each landmark appears at the frame of its first observation."""
    count = len(estimate.landmark_ids)
    covs = estimate.landmark_covs
    return {
        "mapAt": pack(np.zeros(len(shown)), "i4"),
        "start": pack([0, count], "i4"),
        "landmark": pack(estimate.landmark_ids, "i4"),
        "member": pack(np.zeros(count), "u1"),
        "weight": pack(np.full(count, FULL_WEIGHT), "u1"),
        "place": pack(estimate.landmarks),
        "cov": None if covs is None else pack(triangle(covs)),
        "since": pack(np.searchsorted(shown, first_seen(recording, estimate)), "i4"),
        "isHistory": False,
    }


def triangle(covs: Float) -> Float:
    """Return xx, xy, yy (n, 3) of covariances (n, 2, 2) or larger."""
    return np.column_stack([covs[:, 0, 0], covs[:, 0, 1], covs[:, 1, 1]])
