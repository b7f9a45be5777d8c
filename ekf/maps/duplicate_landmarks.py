"""Which tracks of a scan are landmarks of the map, known by another name: judged for all of the scan jointly.

A robot that comes back with a position known badly cannot tell from one scan which landmark is which. What it sees
there begins tracks: a small map of its own, tied to the old one through the robot. A matching says of every track
which landmark it is, or that it is new. The differences d of k tracks and their landmarks, with covariance C, and
m - k new ones at `density` give it the weight

    N(d; 0, C) density^(m - k).

As long as the weight is spread over several matchings nothing is decided. What nearly all of it agrees on is joined,
and until then the robot's pose is the mean over the matchings.

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

MOST_TRACKS = 12  # of a scan that are matched at a time, those first that were seen most
MOST_MATCHINGS = 64  # that are followed from track to track, the heaviest
NEGLIGIBLE = 1e-3  # weight of a matching that the robot's pose does without
ROUNDING = 1e-9  # of a variance


class Matchings(NamedTuple):
    """Matchings of tracks with landmarks, heaviest first."""

    pairs: Int  # (p, 2) slots of a track and of a landmark that it may be
    chosen: Int  # (h, m) for each matching and track the pair, or NONE
    weight: Float  # (h,) adding up to one

    def agreed(self, certainty: float) -> Int:
        """Pairs (k, 2) of the heaviest matching that matchings of at least that weight have in common."""
        best = self.chosen[0][self.chosen[0] != NONE]
        shares = [self.weight[(self.chosen == each).any(axis=1)].sum() for each in best]
        return self.pairs[best[np.array(shares) >= certainty]]


def find_matchings(landmarks: LandmarkMap, pairs: Int, sights: Int, density: float) -> Matchings:
    """The likeliest matchings, if `pairs` (p, 2) of the slots of a track and a landmark are possible.

    None is matched where rounding hides the covariance of their differences.

    Args:
        landmarks: the map.
        pairs: p >= 1 of them; no slot is that of a track in one and of a landmark in another.
        sights: (L,) of each slot.
        density: of landmarks that are new [1/m^2].
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
    """Pose (3,) and covariance (3, 3) of the robot: mean and covariance over the matchings."""
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
    """Track minus landmark (2p,) [m] of all pairs, and the covariance (2p, 2p)."""
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
    """Matchings (h, m) with that pair, or NONE, as choice of one track more, where its landmark (of all p) is free."""
    free: Marks = np.ones(len(chosen), dtype=np.bool_)
    if pair != NONE:
        free = ((chosen == NONE) | (landmark[chosen] != landmark[pair])).all(axis=1)
    return np.column_stack([chosen[free], np.full(int(free.sum()), pair)])


def _log_weights(chosen: Int, difference: Float, cov: Float, density: float) -> Float:
    """Logarithms (h,) of the weights of matchings (h, m); the differences of new tracks are 0 with variance 1."""
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
