"""Partition of a long path through a large map into pieces, each with the few landmarks that its scans observe.

The first pose of a piece is an unknown, like its landmarks; its last pose is the first pose of the next piece. The
first piece starts with the prior. The covariance of a piece's last pose given its unknowns must have full rank, and its
inverse must not dominate other information in double precision. Therefore a path is cut only at poses where the
motions since the last cut have added enough noise in every direction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Int, Marks
from slamgauge.graph_baseline.problem.linearisation import LinearModel
from slamgauge.graph_baseline.solver.elimination import Scans, noise_between
from slamgauge.graph_baseline.solver.multifrontal import Front, multiply_adds, nested_dissection

LANDMARKS = 64  # a piece ends with the scan that exceeds this number
LEAST_NOISE = 1e-8  # smallest variance of a piece in any direction, relative to the variance since the start
OVERHEAD = 1.5e7  # fixed cost of a piece, in multiply-adds


class Piece(NamedTuple):
    """Poses from one cut to the next, both included; the scan of the last pose belongs to the next piece."""

    poses: slice
    rows: slice  # observations
    slots: Int  # (l,) landmarks
    columns: Int  # (n,) indices of the piece's unknowns: landmarks, first pose, last pose
    begins: bool  # True if the first pose is an unknown
    ends: bool  # True if the last pose is an unknown


class Plan(NamedTuple):
    """Pieces and their elimination tree; unknowns are the landmarks (L, 2), then the poses at cuts (J, 3)."""

    pieces: list[Piece]
    front: Front
    landmarks: int  # L
    unknowns: int  # 2 L + 3 J


def plan(scans: Scans, model: LinearModel, landmarks: int) -> Plan:
    """Return the pieces of a path, or the whole path as one piece if that needs fewer operations."""
    whole = plan_of(scans, model, landmarks, np.zeros(0, dtype=np.int64))
    if landmarks <= 2 * LANDMARKS or len(np.unique(scans.slot)) < landmarks:
        return whole
    return min((whole, plan_of(scans, model, landmarks, cuts(scans, model))), key=work)


def work(planned: Plan) -> float:
    """Return the number of multiply-adds, up to a small factor."""
    sizes = [(each.poses.stop - each.poses.start, len(each.columns)) for each in planned.pieces]
    return sum(6.0 * poses * unknowns**2 + OVERHEAD for poses, unknowns in sizes) + multiply_adds(planned.front)


def cuts(scans: Scans, model: LinearModel) -> Int:
    """Return the poses (J,) at which to cut; the first and the last pose are not among them."""
    first, slot = scans.first.tolist(), scans.slot.tolist()
    found: list[int] = []
    seen = set[int]()
    for k in range(len(model.c) - 1):
        if len(seen) > LANDMARKS:
            found.append(k)
            seen = set()
        seen.update(slot[first[k] : first[k + 1]])
    cut = np.array(found, dtype=np.int64)
    while not (noisy := _are_noisy(model, cut)).all():  # remove every second one of consecutive invalid cuts
        number = np.arange(len(cut))
        in_row = number - np.maximum.accumulate(np.where(noisy, number, -1))
        cut = cut[in_row % 2 == 0]
    return cut


def _are_noisy(model: LinearModel, cut: Int) -> Marks:
    """Return for each cut (J,) whether the motions since the previous cut add enough noise in every direction."""
    variance = np.cumsum(np.diagonal(model.W, axis1=1, axis2=2), axis=0)[cut]
    sigma = np.sqrt(np.where(variance > 0.0, variance, np.inf))
    noise = noise_between(model, cut) / (sigma[:, :, None] * sigma[:, None, :])
    return np.linalg.eigvalsh(noise)[:, 0] > LEAST_NOISE


def plan_of(scans: Scans, model: LinearModel, landmarks: int, cut: Int) -> Plan:
    """Return the pieces of a path that is cut at the poses `cut` (J,)."""
    ends = np.concatenate([[0], cut, [len(model.c) - 1]])
    pieces = [_piece(scans, landmarks, ends, number) for number in range(len(cut) + 1)]
    place = np.cumsum(model.lever, axis=0)  # (-y, x) of each pose
    front = nested_dissection([each.columns for each in pieces], (place[ends[:-1]] + place[ends[1:]]) / 2)
    return Plan(pieces, front, landmarks, 2 * landmarks + 3 * len(cut))


def _piece(scans: Scans, landmarks: int, ends: Int, number: int) -> Piece:
    first, last = ends[number : number + 2].tolist()
    begins, finishes = number > 0, number < len(ends) - 2
    rows = slice(int(scans.first[first]), int(scans.first[last if finishes else last + 1]))
    slots = np.unique(scans.slot[rows]) if begins or finishes else np.arange(landmarks)
    poses = np.arange(2 * landmarks + 3 * (number - 1), 2 * landmarks + 3 * (number + 1))
    poses = poses[0 if begins else 3 : None if finishes else 3]
    columns = np.concatenate([(2 * slots[:, None] + np.arange(2)).ravel(), poses])
    return Piece(slice(first, last + 1), rows, slots, columns, begins, finishes)
