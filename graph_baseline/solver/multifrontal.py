"""The information of many unknowns as a tree of small dense matrices: factor, solution, and roots of the covariance.

A leaf is a piece of the recording with the few unknowns that it speaks of. A front joins two parts; what no piece
outside speaks of is eliminated there, and what that leaves is information about the unknowns shared with others. Pieces
near each other meet first, so that little is ever shared: nested dissection (George, SIAM J. Numer. Anal. 10(2), 1973),
its fronts as in Duff & Reid (ACM TOMS 9(3), 1983).

Back from the last front to the pieces goes a root R of the covariance, RR', of each front's unknowns,

    R = [L^-T, -L^-T K'S; 0, S]    L the factor of what is eliminated, K what that tells of the shared unknowns,
                                   S the root of those, known from the front above,

which is the selected inversion of Takahashi, Fagan & Chin (1973) without a difference of covariances: unknowns that are
known far worse than others do not drown these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from slamgauge.arrays import Float, Int

EXHAUSTED = 1e-12  # share of a landmark's information that rounding hides
ASSEMBLY = 300.0  # multiply-adds in the time that a number of a front takes to be put in place


class Front(NamedTuple):
    """Unknowns of a piece, or what two parts share of theirs."""

    parts: tuple[Front, ...]  # none: a piece
    piece: int  # its number, the first of its pieces
    columns: Int  # (n,) numbers of the unknowns
    eliminated: int  # f, so many of them, the first, are eliminated: no other piece speaks of them
    places: tuple[Int, ...]  # where a piece's unknowns, or those that each part shares, stand among them


class Factor(NamedTuple):
    """A front of f eliminated and s shared unknowns, factorised."""

    front: Front
    parts: tuple[Factor, ...]
    root: Float  # (f, f) lower triangular
    rest: Float  # (f, s + 1) of the shared unknowns, and of the constant


def nested_dissection(columns: list[Int], place: Float) -> Front:
    """The tree of pieces that speak of unknowns `columns` each and lie at `place` (pieces, 2)."""
    uses = np.bincount(np.concatenate(columns))
    return _joined(columns, place, uses, np.arange(len(columns)))[0]


def _joined(columns: list[Int], place: Float, uses: Int, pieces: Int) -> tuple[Front, Int]:
    """The front of some pieces, and how many of these speak of each unknown that it shares with others."""
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
    """Pieces on one side and on the other, across the longer side of where they lie."""
    at = place[pieces]
    order = np.argsort(at[:, np.argmax(np.ptp(at, axis=0))], kind="stable")
    return pieces[order[: len(order) // 2]], pieces[order[len(order) // 2 :]]


def multiply_adds(front: Front) -> float:
    """Of its factor and its roots, all parts included, to a small factor."""
    size = len(front.columns)
    shared = size - front.eliminated
    alone = size**2 * front.eliminated + shared**2 * size + ASSEMBLY * size**2
    return alone + sum(map(multiply_adds, front.parts))


def largest(front: Front) -> int:
    """Unknowns of the largest front."""
    return max(len(front.columns), *map(largest, front.parts), 0)


def numbers_kept(front: Front) -> float:
    """Numbers of the factor, all parts included."""
    return len(front.columns) * float(front.eliminated) + sum(map(numbers_kept, front.parts))


def factorise(
    front: Front, information_of: Callable[[int], Float], damping_of: Float, own_information_of: Float
) -> tuple[Factor, Float]:
    """The factor, and what is left (s + 1, s + 1) of shared unknowns and constant.

    Args:
        front: of n unknowns.
        information_of: function from the number of a piece to the information (n + 1, n + 1) of its unknowns and the
            constant.
        damping_of: (all unknowns,) information that is added to each.
        own_information_of: (all unknowns,) information of each if the others are known; 0 skips the check for rounding.

    Raises:
        numpy.linalg.LinAlgError: an unknown is not determined, or (a landmark's) only by rounding.
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
    if (np.square(np.diag(root)) < EXHAUSTED * own_information_of[eliminated]).any():
        raise np.linalg.LinAlgError("what is left of an unknown's information is rounding")
    rest = solve_triangular(root, joint[:count, count:], lower=True, check_finite=False)
    return Factor(front, tuple(parts), root, rest), joint[count:, count:] - rest.T @ rest


def minimise(factor: Factor, unknowns: Float) -> None:
    """Fill `unknowns` (all, and the constant 1 behind them) with the minimum, from the last front to the pieces."""
    front = factor.front
    shared = np.append(front.columns[front.eliminated :], len(unknowns) - 1)
    rhs = factor.rest @ unknowns[shared]
    unknowns[front.columns[: front.eliminated]] = -solve_triangular(
        factor.root, rhs, trans=1, lower=True, check_finite=False
    )
    for part in factor.parts:
        minimise(part, unknowns)


def covariance_roots(factor: Factor, shared: Float) -> Iterator[tuple[int, Int, Float]]:
    """The pieces' numbers; where each one's unknowns stand in its front; of this the root R (n, n), upper triangular.

    RR' is the covariance of the front's unknowns.

    Args:
        factor: of a front.
        shared: (s, s) the root of what it shares; (0, 0) of the last front.
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
