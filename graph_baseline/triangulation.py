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


def triangulate(poses: Float, bearings: Float, variances: Float, sure: float = SURE) -> Triangulation:
    """Weighted least squares on the distances from the lines of sight.

    Args:
        poses: (n, 3) that saw the landmark.
        bearings: (n,) [rad] in the body frame.
        variances: (n,) [rad^2].
        sure: largest standard deviation of a landmark that is `placed`, as a share of its distance.

    Returns:
        The landmark; one that is placed lies in front of the poses.
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
    return Triangulation(landmark, sigma, placed=bool(ahead > 0.5 and sigma < sure * distance.min()))


def tracks(recording: Recording, rows: Int) -> list[Int]:
    """The rows of a landmark's observations, parted at its long absences."""
    stamps = recording.stamps[recording.observation_step[rows]]
    return np.split(rows, np.flatnonzero(np.diff(stamps) > TRACK_BREAK) + 1)


def triangulate_all(recording: Recording, poses: Float) -> tuple[Int, Float, Float]:
    """Ids (L,) in increasing order, landmarks (L, 2) and sigmas (L,) [m] of a bearing-only recording seen from `poses`.

    A landmark is triangulated from the first track that places it, or from all its bearings; sigma is infinite where
    nothing does.
    """
    assert recording.landmark is not None
    ids = np.unique(recording.landmark)
    landmarks, sigmas = np.zeros((len(ids), 2)), np.full(len(ids), np.inf)
    variances = recording.observation_cov[:, 0, 0]
    for slot, name in enumerate(ids.tolist()):
        rows = np.flatnonzero(recording.landmark == name)
        for chosen in (*tracks(recording, rows), rows):
            seen_from = poses[recording.observation_step[chosen]]
            found = triangulate(seen_from, recording.observation[chosen, 0], variances[chosen])
            landmarks[slot] = found.landmark
            if found.placed:
                sigmas[slot] = found.sigma
                break
    return ids, landmarks, sigmas
