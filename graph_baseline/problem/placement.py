"""Positions of landmarks given a path, and which landmarks the observations place."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.graph_baseline.problem.preparation import Problem, as_range_bearing
from slamgauge.graph_baseline.problem.undetermined import undetermined_variable
from slamgauge.recording import Recording
from slamgauge.se2 import rotation
from slamgauge.sensors import SENSORS, inverse
from slamgauge.triangulation import triangulate

SURE = 0.3  # largest standard deviation of a placed landmark, relative to its distance
MAX_LANDMARK_SIGMA = 3e5  # m; the information of a larger value is rounding, relative to that of a millimetre
TRACK_BREAK = 1.0  # time without observation that ends a track [s], because the path drifts meanwhile


def tracks(recording: Recording, rows: Int) -> list[Int]:
    """Return the rows of a landmark's observations, split into tracks without long gaps."""
    stamps = recording.stamps[recording.observation_step[rows]]
    return np.split(rows, np.flatnonzero(np.diff(stamps) > TRACK_BREAK) + 1)


def triangulate_all(recording: Recording, poses: Float) -> tuple[Int, Float, Float]:
    """Return ids (L,), landmarks (L, 2) and sigmas (L,) [m] of a bearing-only recording observed from `poses`.

    Ids are increasing. A landmark is triangulated from the first track that places it, or else from all its bearings.
    Its sigma is infinite if these do not place it.
    """
    assert recording.landmark is not None
    ids = np.unique(recording.landmark)
    landmarks, sigmas = np.zeros((len(ids), 2)), np.full(len(ids), np.inf)
    for slot, name in enumerate(ids.tolist()):
        landmarks[slot], sigmas[slot] = triangulate_one(recording, np.flatnonzero(recording.landmark == name), poses)
    return ids, landmarks, sigmas


def triangulate_one(recording: Recording, rows: Int, poses: Float, sure: float = SURE) -> tuple[Float, float]:
    """Return landmark (2,) and sigma [m], as in `triangulate_all`, from the bearings in `rows`."""
    landmark, bearings, variances = np.zeros(2), recording.observation[:, 0], recording.observation_cov[:, 0, 0]
    for chosen in (*tracks(recording, rows), rows):
        seen_from = poses[recording.observation_step[chosen]]
        found = triangulate(seen_from, bearings[chosen], variances[chosen], sure)
        landmark = found.landmark
        if found.placed:
            return landmark, found.sigma
    return landmark, np.inf


def are_placed(recording: Problem, path: Float) -> Marks:
    """Return a mask (M,) of the observations whose landmark has a position, given a path (N+1, 3).

    A sensor that measures ranges or positions places all landmarks. A bearing-only landmark cannot be placed from one
    observation or without parallax; its bearings contain almost no information about the path.
    """
    if SENSORS[recording.sensor].places_landmarks:
        return np.ones(len(recording.observation), dtype=bool)
    ids, _, sigmas = triangulate_all(recording, path)
    return np.isin(recording.landmark, ids[np.isfinite(sigmas)])


def are_reobserved(recording: Problem) -> Marks:
    """Return a mask (M,) of the observations of landmarks that are observed at two or more steps."""
    slot = recording.slot
    pairs = np.unique(np.column_stack([slot, recording.observation_step]), axis=0)
    return np.bincount(pairs[:, 0])[slot] > 1


def landmarks_at_median(recording: Problem, poses: Float) -> Float:
    """Return landmark positions (L, 2) [m] in increasing id order, given `poses` (N+1, 3).

    Each coordinate is the median over the positions that the observations of the landmark give, so that misread ids do
    not move landmarks; bearing-only landmarks are triangulated.
    """
    if not SENSORS[recording.sensor].places_landmarks:
        return triangulate_all(recording, poses)[1]
    slot, seen_from = recording.slot, poses[recording.observation_step]
    offset = inverse(recording.sensor, recording.observation)
    points = seen_from[:, :2] + np.einsum("mij,mj->mi", rotation(seen_from[:, 2]), offset)
    count = np.bincount(slot)
    middle = np.cumsum(count) - count + count // 2
    return np.column_stack([each[np.lexsort((each, slot))][middle] for each in points.T])


def least_known_landmark(recording: Problem) -> tuple[int, float]:
    """Return the id of the landmark with the largest sigma, and this sigma [m] along its most uncertain direction.

    The path of dead reckoning is assumed to be exact. The result is (-1, 0.0) without observations.
    """
    if not SENSORS[recording.sensor].places_landmarks:
        ids, _, sigmas = triangulate_all(recording, recording.dead_reckoning)
        worst = int(np.argmax(sigmas)) if len(ids) else -1
        return (int(ids[worst]), float(sigmas[worst])) if len(ids) else (-1, 0.0)
    polar, polar_cov = as_range_bearing(recording)
    if len(polar) == 0:
        return -1, 0.0
    path = recording.dead_reckoning
    H = rotation(path[recording.observation_step, 2] + polar[:, 1]).swapaxes(1, 2)  # rows: along and across the ray
    H[:, 1] /= np.maximum(polar[:, :1], 1e-6)
    information = np.zeros((len(recording.landmark_ids), 2, 2))
    np.add.at(information, recording.slot, H.swapaxes(1, 2) @ np.linalg.inv(polar_cov) @ H)
    weakest = np.linalg.eigvalsh(information)[:, 0]
    worst = int(np.argmin(weakest))
    return int(recording.landmark_ids[worst]), float(1.0 / np.sqrt(max(weakest[worst], 1e-300)))


def require_placeable(recording: Problem) -> None:
    """Check that observations determine each landmark well enough for double precision; bearing-only passes.

    Raises:
        UserError: the sigma of a landmark exceeds MAX_LANDMARK_SIGMA.
    """
    if SENSORS[recording.sensor].places_landmarks:
        landmark, sigma = least_known_landmark(recording)
        if sigma > MAX_LANDMARK_SIGMA:
            raise undetermined_variable("l", landmark)
