"""A chain cut into pieces, each with the few landmarks that its scans see.

A piece begins with a pose that is an unknown, as its landmarks are, and ends with the one that the next begins with;
the first begins with the prior. What its motions and scans say of the last pose has a covariance of full rank: a chain
is cut only where the motions since the last cut leave no direction of the pose without noise, nor one with so little
that its inverse would hide the rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Int, Marks
from slamgauge.graph_baseline.solver.motion_elimination import Between, Chain, propagated_covariances, sums_within
from slamgauge.graph_baseline.solver.multifrontal import Front, multiply_adds, nested_dissection

LANDMARKS = 64  # of a piece: with the scan that sees more it ends
LEAST = 1e-8  # of the variances of start and motions so far, in any direction: less noise of a piece is none
OVERHEAD = 1.5e7  # multiply-adds in the time that a piece takes whatever its size


class Piece(NamedTuple):
    """Keys of a chain from one cut to the next, both included; the scan of the last is told by the next piece."""

    chain: Chain  # its own keys, poses and landmarks; the keys' poses keep their numbers
    slots: Int  # (l,) its landmarks
    begins: bool  # with a pose that is an unknown
    ends: bool
    columns: Int  # numbers of its unknowns: of its landmarks, its first pose, its last pose


class Plan(NamedTuple):
    """Pieces, and the tree in which they meet; unknowns are the landmarks (L, 2), then the poses at cuts (J, 3)."""

    pieces: list[Piece]
    front: Front
    unknowns: int


def plan(chain: Chain, landmarks: int) -> Plan:
    """The pieces of a chain, or all of it as one, whichever takes less work."""
    whole = plan_of(chain, landmarks, np.zeros(0, dtype=np.int64))
    if landmarks <= 2 * LANDMARKS or len(np.unique(chain.model.slot)) < landmarks:
        return whole
    cut = plan_of(chain, landmarks, cuts(chain))
    return min((whole, cut), key=work)


def work(planned: Plan) -> float:
    """Multiply-adds, to a small factor."""
    alone = sum(6.0 * len(each.chain.key) * len(each.columns) ** 2 + OVERHEAD for each in planned.pieces)
    return alone + multiply_adds(planned.front)


def cuts(chain: Chain) -> Int:
    """Keys (J,) at which to cut, without the first and the last."""
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
    while not (noisy := _is_noisy(chain, cut)).all():  # of cuts in a row that are none, every second may be one
        number = np.arange(len(cut))
        in_row = number - np.maximum.accumulate(np.where(noisy, number, -1))
        cut = cut[in_row % 2 == 0]
    return cut


def _is_noisy(chain: Chain, cut: Int) -> Marks:
    """Whether the motions since the cut before leave no direction of the pose at each cut (J,) without noise."""
    model = chain.model
    key = np.concatenate([[0], cut, [len(model.F)]])
    segment = np.searchsorted(key, np.arange(1, len(model.F) + 1)) - 1
    lever = sums_within(segment, key, model.F[:, :2, 2])
    noise = propagated_covariances(segment, key, lever, model.W)[cut - 1]
    variance = np.diag(model.start_cov) + np.cumsum(np.diagonal(model.W, axis1=1, axis2=2), axis=0)[cut - 1]
    sigma = np.sqrt(np.where(variance > 0.0, variance, np.inf))
    return np.linalg.eigvalsh(noise / (sigma[:, :, None] * sigma[:, None, :]))[:, 0] > LEAST


def plan_of(chain: Chain, landmarks: int, cut: Int) -> Plan:
    """The pieces of a chain that is cut at the keys (J,)."""
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
    own = model._replace(
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
        own = own._replace(start=np.zeros(3), start_cov=np.zeros((3, 3)))
    places = slice(*np.searchsorted(chain.between.key, [first + 1, last + 1]).tolist())
    pose, key, lever_from, lever_to, c, W = chain.between
    between = Between(pose[places], key[places] - first, lever_from[places], lever_to[places], c[places], W[places])
    poses = np.arange(2 * landmarks + 3 * (number - 1), 2 * landmarks + 3 * (number + 1))
    return Piece(
        Chain(own, chain.key[first : last + 1], between),
        slots,
        begins,
        finishes,
        np.concatenate(
            [(2 * slots[:, None] + np.arange(2)).ravel(), poses[0 if begins else 3 : None if finishes else 3]]
        ),
    )
