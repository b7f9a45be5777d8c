"""Partition of a chain of poses into pieces, each with the few landmarks that its scans observe.

The first pose of a piece is an unknown, like its landmarks; its last pose is the first pose of the next piece. The
first piece starts with the prior. The covariance of a piece's last pose given its unknowns must have full rank, and its
inverse must not dominate other information in double precision. Therefore a chain is cut only at poses where the
motions since the last cut have added enough noise in every direction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Int, Marks
from slamgauge.graph_baseline.solver.motion_elimination import Between, Chain, propagated_covariances, sums_within
from slamgauge.graph_baseline.solver.multifrontal import Front, multiply_adds, nested_dissection

LANDMARKS = 64  # a piece ends with the scan that exceeds this number
LEAST = 1e-8  # smallest variance of a piece in any direction, relative to the variance since the start
OVERHEAD = 1.5e7  # fixed cost of a piece, in multiply-adds


class Piece(NamedTuple):
    """Keys of a chain from one cut to the next, both included; the scan of the last key belongs to the next piece."""

    chain: Chain  # keys and landmarks are numbered within the piece; `key` contains pose numbers of the whole path
    slots: Int  # (l,) landmarks of the piece
    begins: bool  # True if the first pose is an unknown
    ends: bool  # True if the last pose is an unknown
    columns: Int  # indices of the piece's unknowns: landmarks, first pose, last pose


class Plan(NamedTuple):
    """Pieces and their elimination tree; unknowns are the landmarks (L, 2), then the poses at cuts (J, 3)."""

    pieces: list[Piece]
    front: Front
    unknowns: int


def plan(chain: Chain, landmarks: int) -> Plan:
    """Return the pieces of a chain, or the whole chain as one piece if that needs fewer operations."""
    whole = plan_of(chain, landmarks, np.zeros(0, dtype=np.int64))
    if landmarks <= 2 * LANDMARKS or len(np.unique(chain.model.slot)) < landmarks:
        return whole
    cut = plan_of(chain, landmarks, cuts(chain))
    return min((whole, cut), key=work)


def work(planned: Plan) -> float:
    """Return the number of multiply-adds, up to a small factor."""
    recursions = sum(6.0 * len(each.chain.key) * len(each.columns) ** 2 + OVERHEAD for each in planned.pieces)
    return recursions + multiply_adds(planned.front)


def cuts(chain: Chain) -> Int:
    """Return the keys (J,) at which to cut; the first and the last key are not among them."""
    first = np.searchsorted(chain.model.step, np.arange(len(chain.key) + 1)).tolist()
    slot = chain.model.slot.tolist()
    found: list[int] = []
    seen = set[int]()
    for k in range(len(chain.key) - 1):
        if len(seen) > LANDMARKS:
            found.append(k)
            seen = set()
        seen.update(slot[first[k] : first[k + 1]])
    cut = np.array(found, dtype=np.int64)
    while not (noisy := _is_noisy(chain, cut)).all():  # remove every second one of consecutive invalid cuts
        number = np.arange(len(cut))
        in_row = number - np.maximum.accumulate(np.where(noisy, number, -1))
        cut = cut[in_row % 2 == 0]
    return cut


def _is_noisy(chain: Chain, cut: Int) -> Marks:
    """Return for each cut (J,) whether the motions since the previous cut add enough noise in every direction."""
    model = chain.model
    key = np.concatenate([[0], cut, [len(model.F)]])
    segment = np.searchsorted(key, np.arange(1, len(model.F) + 1)) - 1
    lever = sums_within(segment, key, model.F[:, :2, 2])
    noise = propagated_covariances(segment, key, lever, model.W)[cut - 1]
    variance = np.diag(model.start_cov) + np.cumsum(np.diagonal(model.W, axis1=1, axis2=2), axis=0)[cut - 1]
    sigma = np.sqrt(np.where(variance > 0.0, variance, np.inf))
    return np.linalg.eigvalsh(noise / (sigma[:, :, None] * sigma[:, None, :]))[:, 0] > LEAST


def plan_of(chain: Chain, landmarks: int, cut: Int) -> Plan:
    """Return the pieces of a chain that is cut at the keys `cut` (J,)."""
    ends = np.concatenate([[0], cut, [len(chain.key) - 1]])
    if len(cut) == 0:
        pieces = [Piece(chain, np.arange(landmarks), False, False, np.arange(2 * landmarks))]
    else:
        pieces = [_piece(chain, landmarks, ends, number) for number in range(len(cut) + 1)]
    lever = np.concatenate([np.zeros((1, 2)), np.cumsum(chain.model.F[:, :2, 2], axis=0)])  # (-y, x) of each key
    front = nested_dissection([piece.columns for piece in pieces], (lever[ends[:-1]] + lever[ends[1:]]) / 2)
    return Plan(pieces, front, 2 * landmarks + 3 * len(cut))


def _piece(chain: Chain, landmarks: int, ends: Int, number: int) -> Piece:
    first, last = ends[number : number + 2].tolist()
    model, begins, finishes = chain.model, number > 0, number < len(ends) - 2
    rows = slice(*np.searchsorted(model.step, [first, last if finishes else last + 1]).tolist())
    slots, slot = np.unique(model.slot[rows], return_inverse=True)
    moves = slice(first, last)
    part = model._replace(
        F=model.F[moves],
        c=model.c[moves],
        W=model.W[moves],
        Hx=model.Hx[rows],
        Hm=model.Hm[rows],
        r=model.r[rows],
        step=model.step[rows] - first,
        slot=slot,
    )
    if begins:
        part = part._replace(start=np.zeros(3), start_cov=np.zeros((3, 3)))
    places = slice(*np.searchsorted(chain.between.key, [first + 1, last + 1]).tolist())
    pose, key, lever_from, lever_to, c, W = chain.between
    between = Between(pose[places], key[places] - first, lever_from[places], lever_to[places], c[places], W[places])
    poses = np.arange(2 * landmarks + 3 * (number - 1), 2 * landmarks + 3 * (number + 1))
    return Piece(
        Chain(part, chain.key[first : last + 1], between),
        slots,
        begins,
        finishes,
        np.concatenate(
            [(2 * slots[:, None] + np.arange(2)).ravel(), poses[0 if begins else 3 : None if finishes else 3]]
        ),
    )
