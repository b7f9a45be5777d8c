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

from slamgauge.arrays import Float, Int, Marks

EXHAUSTED = 1e-12  # share of a landmark's information that rounding hides


class Front(NamedTuple):
    """Unknowns of a piece, or what two parts share of theirs."""

    parts: tuple[Front, ...]  # none: a piece
    piece: int  # its number, the first of its pieces
    columns: Int  # (n,) numbers of the unknowns, increasing
    done: Marks  # (n,) those that no other piece speaks of


class Factor(NamedTuple):
    """A front of f eliminated and s shared unknowns, factorised."""

    front: Front
    parts: tuple[Factor, ...]
    root: Float  # (f, f) lower triangular
    rest: Float  # (s + 1, f) of the shared unknowns, and of the constant


def dissected(columns: list[Int], place: Float) -> Front:
    """The tree of pieces that speak of unknowns `columns`, each increasing, and lie at `place` (pieces, 2)."""
    speakers = np.bincount(np.concatenate(columns))
    return _joined(columns, place, speakers, np.arange(len(columns)))[0]


def _joined(columns: list[Int], place: Float, speakers: Int, pieces: Int) -> tuple[Front, Int]:
    """The front of some pieces, and how many of these speak of each unknown that it shares with others."""
    if len(pieces) == 1:
        parts = ()
        unknowns, count = columns[pieces[0]], np.ones(len(columns[pieces[0]]), dtype=np.int64)
    else:
        halves = [_joined(columns, place, speakers, half) for half in _halves(place, pieces)]
        parts = tuple(front for front, _ in halves)
        shared = np.concatenate([front.columns[~front.done] for front in parts])
        unknowns, at = np.unique(shared, return_inverse=True)
        count = np.bincount(at, np.concatenate([each for _, each in halves]), len(unknowns)).astype(np.int64)
    done = count == speakers[unknowns]
    return Front(parts, int(pieces[0]), unknowns, done), count[~done]


def _halves(place: Float, pieces: Int) -> tuple[Int, Int]:
    """Pieces on one side and on the other, across the longer side of where they lie."""
    at = place[pieces]
    order = np.argsort(at[:, np.argmax(np.ptp(at, axis=0))], kind="stable")
    return pieces[order[: len(order) // 2]], pieces[order[len(order) // 2 :]]


def multiply_adds(front: Front) -> float:
    """Of its factor, all parts included, to a small factor."""
    return len(front.columns) ** 2 * float(front.done.sum()) + sum(map(multiply_adds, front.parts))


def factorised(front: Front, told: Callable[[int], Float], held: Float, own: Float) -> tuple[Factor, Float]:
    """The factor, and what is left (s + 1, s + 1) of shared unknowns and constant.

    Args:
        front: of n unknowns.
        told: by the number of a piece the information (n + 1, n + 1) of its unknowns and the constant.
        held: (all unknowns,) information that is added to each.
        own: (all unknowns,) information of each where the others are known.

    Raises:
        numpy.linalg.LinAlgError: an unknown is not determined, or only by rounding.
    """
    parts: tuple[Factor, ...] = ()
    if front.parts:
        parts, joint = _assembled(front, told, held, own)
    else:
        joint = told(front.piece)
    done, eliminated = np.append(front.done, False), front.columns[front.done]
    information = joint[np.ix_(done, done)]
    information[np.diag_indices(len(eliminated))] += held[eliminated]
    root = np.asarray(np.linalg.cholesky(information), dtype=np.float64)
    if (np.square(np.diag(root)) < EXHAUSTED * own[eliminated]).any():
        raise np.linalg.LinAlgError("what is left of an unknown's information is rounding")
    rest = solve_triangular(root, joint[np.ix_(done, ~done)], lower=True, check_finite=False).T
    return Factor(front, parts, root, rest), joint[np.ix_(~done, ~done)] - rest @ rest.T


def _assembled(front: Front, told: Callable[[int], Float], held: Float, own: Float) -> tuple[tuple[Factor, ...], Float]:
    """The factors of a front's parts, and the sum (n + 1, n + 1) of what they leave."""
    joint = np.zeros((len(front.columns) + 1, len(front.columns) + 1))
    factors: list[Factor] = []
    for part in front.parts:
        factor, left = factorised(part, told, held, own)
        at = np.append(_places(front, part), len(front.columns))
        joint[np.ix_(at, at)] += left
        factors.append(factor)
    return tuple(factors), joint


def minimise(factor: Factor, unknowns: Float) -> None:
    """Fill `unknowns` (all, and the constant 1 behind them) with the minimum, from the last front to the pieces."""
    front = factor.front
    shared = np.append(front.columns[~front.done], len(unknowns) - 1)
    pull = unknowns[shared] @ factor.rest
    unknowns[front.columns[front.done]] = -solve_triangular(factor.root, pull, trans=1, lower=True, check_finite=False)
    for part in factor.parts:
        minimise(part, unknowns)


def covariance_roots(factor: Factor, shared: Float) -> Iterator[tuple[int, Float]]:
    """The pieces' numbers, and roots R (n, r) of the covariance RR' of each one's unknowns.

    Args:
        factor: of a front.
        shared: (s, r) a root of what it shares; (0, 0) of the last front.
    """
    front = factor.front
    right = np.hstack([np.eye(len(factor.root)), -factor.rest[:-1].T @ shared])
    roots = np.zeros((len(front.columns), right.shape[1]))
    roots[front.done] = solve_triangular(factor.root, right, trans=1, lower=True, check_finite=False)
    roots[~front.done, len(factor.root) :] = shared
    if not factor.parts:
        yield front.piece, roots
    for part in factor.parts:
        rows = roots[_places(front, part.front)]
        yield from covariance_roots(part, np.linalg.qr(rows.T, mode="r").T)


def _places(front: Front, part: Front) -> Int:
    """Where the unknowns that a part shares stand among the front's."""
    return np.searchsorted(front.columns, part.columns[~part.done])
