"""Multifrontal Cholesky factorisation of the information of many unknowns, with solution and covariance roots.

A leaf of the elimination tree is a piece of the recording with its few unknowns. A front joins two parts. It eliminates
the unknowns that no other piece uses; the Schur complement is information about the unknowns that it shares with other
pieces. Neighbouring pieces are joined first, so that few unknowns are shared: nested dissection (George, SIAM J. Numer.
Anal. 10(2), 1973). Fronts are those of Duff & Reid (ACM TOMS 9(3), 1983).

From the root of the tree to the leaves, each front computes a root R of the covariance RR' of its unknowns,

    R = [L^-T, -L^-T K'S; 0, S]    L: factor of the eliminated unknowns, K: their coupling with the shared unknowns,
                                   S: root of the shared unknowns, from the parent front.

This is the selected inversion of Takahashi, Fagan & Chin (1973) without subtraction of covariances, so that very
uncertain unknowns do not reduce the accuracy of the others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from slamgauge.arrays import Float, Int

LOST_PIVOT = 1e-12  # a pivot below this share of a landmark's information is rounding
ASSEMBLY = 300.0  # cost of assembling one number of a front, in multiply-adds


class Front(NamedTuple):
    """Unknowns of a piece, or the shared unknowns of two parts."""

    parts: tuple[Front, ...]  # empty for a piece
    piece: int  # number of the first piece
    columns: Int  # (n,) indices of the unknowns; eliminated unknowns come first
    eliminated: int  # f, the number of unknowns that no other piece uses
    places: tuple[Int, ...]  # position in `columns` of a piece's unknowns, or of the unknowns that each part shares


class Factor(NamedTuple):
    """Factor of a front with f eliminated and s shared unknowns."""

    front: Front
    parts: tuple[Factor, ...]
    root: Float  # (f, f) lower triangular
    rest: Float  # (f, s + 1) coupling with the shared unknowns and the constant


def nested_dissection(columns: list[Int], place: Float) -> Front:
    """Return the elimination tree of pieces with the unknowns `columns`, at positions `place` (pieces, 2)."""
    uses = np.bincount(np.concatenate(columns))
    return _joined(columns, place, uses, np.arange(len(columns)))[0]


def _joined(columns: list[Int], place: Float, uses: Int, pieces: Int) -> tuple[Front, Int]:
    """Return the front of some pieces, and how many of these pieces use each shared unknown of the front."""
    parts: tuple[Front, ...] = ()
    if len(pieces) == 1:
        shared = [columns[pieces[0]]]
        counts = [np.ones(len(shared[0]), dtype=np.int64)]
    else:
        halves = [_joined(columns, place, uses, half) for half in _halves(place, pieces)]
        parts, counts = tuple(part for part, _ in halves), [count for _, count in halves]
        shared = [part.columns[part.eliminated :] for part in parts]
    unknowns, at = np.unique(np.concatenate(shared), return_inverse=True)
    count = np.bincount(at, np.concatenate(counts), len(unknowns)).astype(np.int64)
    complete = count == uses[unknowns]
    order = np.argsort(~complete, kind="stable")
    rank = np.argsort(order)[at]
    places = tuple(np.split(rank, np.cumsum([len(each) for each in shared])[:-1]))
    eliminated = int(complete.sum())
    return Front(parts, int(pieces[0]), unknowns[order], eliminated, places), count[order[eliminated:]]


def _halves(place: Float, pieces: Int) -> tuple[Int, Int]:
    """Split pieces into two halves along the longer side of their bounding box."""
    at = place[pieces]
    order = np.argsort(at[:, np.argmax(np.ptp(at, axis=0))], kind="stable")
    return pieces[order[: len(order) // 2]], pieces[order[len(order) // 2 :]]


def multiply_adds(front: Front) -> float:
    """Return the multiply-adds of factor and roots of a front and all its parts, up to a small factor."""
    size = len(front.columns)
    shared = size - front.eliminated
    of_front = size**2 * front.eliminated + shared**2 * size + ASSEMBLY * size**2
    return of_front + sum(map(multiply_adds, front.parts))


def largest(front: Front) -> int:
    """Return the number of unknowns of the largest front."""
    return max(len(front.columns), *map(largest, front.parts), 0)


def numbers_kept(front: Front) -> float:
    """Return how many numbers the factor of a front and all its parts stores."""
    return len(front.columns) * float(front.eliminated) + sum(map(numbers_kept, front.parts))


def factorise(
    front: Front, information_of: Callable[[int], Float], damping_of: Float, own_information_of: Float
) -> tuple[Factor, Float]:
    """Return the factor, and the remaining information (s + 1, s + 1) about shared unknowns and the constant.

    Args:
        front: front with n unknowns.
        information_of: function from the number of a piece to the information (n + 1, n + 1) about its unknowns and the
            constant.
        damping_of: (all unknowns,) information that is added to each.
        own_information_of: (all unknowns,) information of each unknown given all others; 0 skips the rounding check.

    Raises:
        numpy.linalg.LinAlgError: the information does not determine an unknown, or its pivot is only rounding.
    """
    parts: list[Factor] = []
    size, count = len(front.columns), front.eliminated
    joint = np.zeros((size + 1, size + 1))
    for number, place in enumerate(front.places):
        if front.parts:
            part, left = factorise(front.parts[number], information_of, damping_of, own_information_of)
            parts.append(part)
        else:
            left = information_of(front.piece)
        at = np.append(place, size)
        joint[np.ix_(at, at)] += left
    eliminated = front.columns[:count]
    joint[np.arange(count), np.arange(count)] += damping_of[eliminated]
    root = np.asarray(np.linalg.cholesky(joint[:count, :count]), dtype=np.float64)
    if (np.square(np.diag(root)) < LOST_PIVOT * own_information_of[eliminated]).any():
        raise np.linalg.LinAlgError("the remaining information of an unknown is rounding")
    rest = solve_triangular(root, joint[:count, count:], lower=True, check_finite=False)
    return Factor(front, tuple(parts), root, rest), joint[count:, count:] - rest.T @ rest


def minimise(factor: Factor, unknowns: Float) -> None:
    """Fill `unknowns` (all unknowns and the constant 1) with the minimum, from the root of the tree to the pieces."""
    front = factor.front
    shared = np.append(front.columns[front.eliminated :], len(unknowns) - 1)
    rhs = factor.rest @ unknowns[shared]
    unknowns[front.columns[: front.eliminated]] = -solve_triangular(
        factor.root, rhs, trans=1, lower=True, check_finite=False
    )
    for part in factor.parts:
        minimise(part, unknowns)


def covariance_roots(factor: Factor, shared: Float) -> Iterator[tuple[int, Int, Float]]:
    """Yield each piece's number, the positions of its unknowns in its front, and the front's root R (n, n).

    R is upper triangular, and RR' is the covariance of the front's unknowns.

    Args:
        factor: factor of a front.
        shared: (s, s) root of its shared unknowns; (0, 0) for the root of the tree.
    """
    front, eliminated = factor.front, factor.front.eliminated
    right = np.hstack([np.eye(eliminated), -factor.rest[:, :-1] @ shared])
    root = np.zeros((len(front.columns), len(front.columns)))
    root[:eliminated] = solve_triangular(factor.root, right, trans=1, lower=True, check_finite=False)
    root[eliminated:, eliminated:] = shared
    if not factor.parts:
        yield front.piece, front.places[0], root
    for part, place in zip(factor.parts, front.places, strict=bool(factor.parts)):
        triangle = np.asarray(np.linalg.qr(root[place[::-1]].T, mode="r"), dtype=np.float64)
        yield from covariance_roots(part, triangle.T[::-1, ::-1])
