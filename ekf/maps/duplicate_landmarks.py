"""Joint detection of duplicate landmarks: tracks of a scan that are old landmarks of the map.

A robot that returns with an uncertain position cannot associate one scan with the old landmarks. Its observations start
tracks: a separate small map, correlated with the old one through the robot. A matching assigns a landmark to every
track, or marks it as new. With the differences d of k tracks and their landmarks, their covariance C, and m - k new
landmarks at `density`, the weight of a matching is

    N(d; 0, C) density^(m - k).

Pairs in which nearly all of the weight agrees are merged. Until then the robot's pose is the mean over the matchings.

Sources: Reid, "An algorithm for tracking multiple targets", IEEE Transactions on Automatic Control 24(6), 1979, for the
weights; Tardos, Neira, Newman and Leonard, "Robust mapping and localization in indoor environments using sonar data",
IJRR 21(4), 2002, for the joint matching of a local map.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.linalg import LinAlgError

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels.individual_compatibility import NONE
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.map_edits import robot_if_merged
from slamgauge.se2 import wrap

MOST_TRACKS = 12  # tracks of a scan that are matched: those with the most observations
MOST_MATCHINGS = 64  # heaviest matchings that are extended by the next track
NEGLIGIBLE = 1e-3  # weight of a matching that the robot's pose ignores
ROUNDING = 1e-9  # relative rounding error of a variance


class Matchings(NamedTuple):
    """Matchings of tracks with landmarks, heaviest first."""

    pairs: Int  # (p, 2) slots of a track and of its possible landmark
    chosen: Int  # (h, m) row of `pairs` for each matching and track, or NONE
    weight: Float  # (h,) with sum 1

    def agreed(self, certainty: float) -> Int:
        """Return the pairs (k, 2) of the heaviest matching on which at least the weight `certainty` agrees."""
        best = self.chosen[0][self.chosen[0] != NONE]
        shares = [self.weight[(self.chosen == each).any(axis=1)].sum() for each in best]
        return self.pairs[best[np.array(shares) >= certainty]]


def find_matchings(landmarks: LandmarkMap, pairs: Int, sights: Int, density: float) -> Matchings:
    """Return the likeliest matchings from the possible `pairs` (p, 2) of slots of a track and a landmark.

    No track is matched if the covariance of the differences is singular by rounding.

    Args:
        landmarks: the map.
        pairs: at least one; a slot is either a track or a landmark in all of them.
        sights: (L,) number of observations of each slot.
        density: density of new landmarks [1/m^2].
    """
    tracks = np.unique(pairs[:, 0])
    tracks = tracks[np.argsort(-sights[tracks], kind="stable")][:MOST_TRACKS]
    pairs = pairs[np.isin(pairs[:, 0], tracks)]
    difference, cov = _differences(landmarks, pairs)
    chosen, weight = np.zeros((1, 0), np.int64), np.ones(1)
    for track in tracks:
        candidates = [NONE, *np.flatnonzero(pairs[:, 0] == track).tolist()]
        chosen = np.concatenate([_extended(chosen, each, pairs[:, 1]) for each in candidates])
        try:
            log_weight = _log_weights(chosen, difference, cov, density)
        except LinAlgError:
            return Matchings(pairs, np.full((1, len(tracks)), NONE), np.ones(1))
        heaviest = np.argsort(-log_weight, kind="stable")[:MOST_MATCHINGS]
        chosen, weight = chosen[heaviest], np.exp(log_weight[heaviest] - log_weight[heaviest[0]])
    return Matchings(pairs, chosen, weight / weight.sum())


def robot_of(landmarks: LandmarkMap, matchings: Matchings) -> tuple[Float, Float]:
    """Return pose (3,) and covariance (3, 3) of the robot: mean and covariance over the matchings."""
    heavy = matchings.weight >= min(NEGLIGIBLE, float(matchings.weight[0]))
    share = matchings.weight[heavy] / matchings.weight[heavy].sum()
    robots = [robot_if_merged(landmarks, matchings.pairs[each[each != NONE]]) for each in matchings.chosen[heavy]]
    poses, covs = (np.stack(each) for each in zip(*robots, strict=True))
    off = poses - poses[0]
    off[:, 2] = wrap(off[:, 2])
    mean = share @ off
    off -= mean
    pose = poses[0] + mean
    pose[2] = wrap(pose[2])
    return pose, np.einsum("h,hij->ij", share, covs + off[:, :, None] * off[:, None, :])


def _differences(landmarks: LandmarkMap, pairs: Int) -> tuple[Float, Float]:
    """Return track minus landmark (2p,) [m] of all pairs, and the covariance (2p, 2p)."""
    slots, places = np.unique(pairs, return_inverse=True)
    track, landmark = places.reshape(-1, 2).T
    columns = (3 + 2 * slots[:, None] + [0, 1]).ravel()
    positions, block = landmarks.state.entries(columns).reshape(-1, 2), landmarks.state.block(columns)
    block = block.reshape(len(slots), 2, len(slots), 2)
    rows = block[track] - block[landmark]
    cov = (rows[:, :, track] - rows[:, :, landmark]).reshape(2 * len(pairs), 2 * len(pairs))
    np.einsum("ii->i", cov)[:] *= 1.0 + ROUNDING
    return (positions[track] - positions[landmark]).ravel(), cov


def _extended(chosen: Int, pair: int, landmark: Int) -> Int:
    """Return matchings (h, m) extended by a track with `pair`, or NONE, if no other track has the landmark (p,)."""
    free: Marks = np.ones(len(chosen), dtype=np.bool_)
    if pair != NONE:
        free = ((chosen == NONE) | (landmark[chosen] != landmark[pair])).all(axis=1)
    return np.column_stack([chosen[free], np.full(int(free.sum()), pair)])


def _log_weights(chosen: Int, difference: Float, cov: Float, density: float) -> Float:
    """Return logarithms (h,) of the weights of matchings (h, m); new tracks have difference 0 with variance 1."""
    matchings, tracks = chosen.shape
    matched = np.repeat(chosen != NONE, 2, axis=1)
    rows = (2 * chosen[:, :, None] + [0, 1]).reshape(matchings, 2 * tracks)
    d = np.where(matched, difference[rows], 0.0)
    C = np.where(matched[:, :, None] & matched[:, None, :], cov[rows[:, :, None], rows[:, None, :]], 0.0)
    diagonal = np.einsum("hii->hi", C)
    diagonal[~matched] = 1.0
    factor = np.linalg.cholesky(C)
    squared = (np.linalg.solve(factor, d[:, :, None])[:, :, 0] ** 2).sum(axis=1)
    known = matched.sum(axis=1) // 2
    log_determinant = 2.0 * np.log(np.einsum("hii->hi", factor)).sum(axis=1)
    normal = -0.5 * (squared + log_determinant) - known * math.log(2.0 * math.pi)
    return normal + (tracks - known) * math.log(density)
