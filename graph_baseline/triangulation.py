"""Where bearings alone place landmarks, and which landmarks they place at all."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slam2d import Float, Int, Recording

SURE = 0.3  # largest standard deviation over distance of a landmark that its bearings place
TRACK_BREAK = 1.0  # s unseen, after which the path may have drifted too far to go on triangulating
REWEIGHTINGS = 5


class Triangulation(NamedTuple):
    """A landmark (2,) [m] from its bearings, and its largest standard deviation [m], poses taken as exact."""

    landmark: Float
    sigma: float
    placed: bool


def triangulate(poses: Float, bearings: Float, variances: Float) -> Triangulation:
    """Weighted least squares on the distances from the lines of sight.

    Args:
        poses: (n, 3) that saw the landmark.
        bearings: (n,) [rad] in the body frame.
        variances: (n,) [rad^2].

    Returns:
        A landmark that is `placed` lies in front of the poses, and is known to a share SURE of its distance.
    """
    angle = poses[:, 2] + bearings
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    across = np.column_stack([-along[:, 1], along[:, 0]])
    distance = np.ones(len(poses))
    landmark, sigma, offset = poses[-1, :2] + along[-1], np.inf, along
    for _ in range(REWEIGHTINGS):
        weighted = across / (variances * distance**2)[:, None]
        information = weighted.T @ across
        weakest = float(np.linalg.eigvalsh(information)[0])
        if not weakest > 1e-12 * float(np.trace(information)):
            return Triangulation(landmark, np.inf, placed=False)
        landmark = np.linalg.solve(information, weighted.T @ (across * poses[:, :2]).sum(axis=1))
        sigma = 1.0 / np.sqrt(weakest)
        offset = landmark - poses[:, :2]
        distance = np.maximum(np.hypot(*offset.T), 1e-3)
    ahead = float(np.mean((offset * along).sum(axis=1) > 0.0))
    return Triangulation(landmark, sigma, placed=bool(ahead > 0.5 and sigma < SURE * distance.min()))


def first_track(recording: Recording, rows: Int) -> Int:
    """The rows of a landmark's observations up to its first long absence."""
    stamps = recording.stamps[recording.observation_step[rows]]
    breaks = np.flatnonzero(np.diff(stamps) > TRACK_BREAK)
    return rows[: breaks[0] + 1] if len(breaks) else rows


def triangulate_all(recording: Recording, poses: Float) -> tuple[Int, Float, Float]:
    """Ids (L,) in increasing order, landmarks (L, 2) and sigmas (L,) [m] of a bearing-only recording seen from `poses`.

    A landmark is triangulated from its first track, or from all its bearings where that does not place it; sigma is
    infinite where neither does.
    """
    assert recording.landmark is not None
    ids = np.unique(recording.landmark)
    landmarks, sigmas = np.zeros((len(ids), 2)), np.full(len(ids), np.inf)
    variances = recording.observation_cov[:, 0, 0]
    for slot, name in enumerate(ids.tolist()):
        rows = np.flatnonzero(recording.landmark == name)
        for chosen in (first_track(recording, rows), rows):
            seen_from = poses[recording.observation_step[chosen]]
            found = triangulate(seen_from, recording.observation[chosen, 0], variances[chosen])
            landmarks[slot] = found.landmark
            if found.placed:
                sigmas[slot] = found.sigma
                break
    return ids, landmarks, sigmas
