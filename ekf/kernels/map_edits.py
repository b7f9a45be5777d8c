"""Changes of the map that no observation makes: removing a landmark, and taking two for one.

Removing is marginalisation: the landmark's rows and columns go, all else stays. Two landmarks are taken
for one by the exact observation l_a - l_b = 0, whose innovation covariance is P_aa + P_bb - P_ab - P_ba;
then one of the two goes.
"""

from __future__ import annotations

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels.compiled import cholesky, combine_rows, kernel, solve_factor, subtract_gram
from slamgauge.ekf.kernels.covariance import mirror_robot_block
from slamgauge.ekf.kernels.workspace import Workspace

NOTHING = (-1, -1)


@kernel
def remove_landmark(state: Float, point: Float, cov: Float, size: int, slot: int) -> None:
    """Take the landmark in `slot` out of the state; the last landmark moves into its place."""
    to, last = 3 + 2 * slot, size - 2
    if to == last:
        return
    for k in range(2):
        state[to + k] = state[last + k]
        point[to + k] = point[last + k]
        for j in range(to):
            cov[j, to + k] = cov[j, last + k]
        for j in range(to + 2, last):
            cov[to + k, j] = cov[j, last + k]
    cov[to, to] = cov[last, last]
    cov[to, to + 1] = cov[last, last + 1]
    cov[to + 1, to + 1] = cov[last + 1, last + 1]


@kernel
def equate_landmarks(state: Float, cov: Float, size: int, a: int, b: int, work: Workspace) -> bool:
    """Take in l_a - l_b = 0 for the landmarks in slots a and b: P <- P - W'W, dx in `work.scratch[0]`.

    Returns False, with nothing changed, when the covariance of their difference is singular: they are one already.
    """
    W, S, y, dx = work.W, work.S, work.innovation, work.scratch[0]
    la, lb = 3 + 2 * a, 3 + 2 * b
    for k in range(2):
        y[k] = state[lb + k] - state[la + k]
        for j in range(size):
            W[k, j] = cov[min(la + k, j), max(la + k, j)] - cov[min(lb + k, j), max(lb + k, j)]
    for k in range(2):
        for j in range(k, 2):
            S[k, j] = W[k, la + j] - W[k, lb + j]
    if not cholesky(S, 2):
        return False
    solve_factor(S, W, 2, size)
    y[0] /= S[0, 0]
    y[1] = (y[1] - S[0, 1] * y[0]) / S[1, 1]
    combine_rows(W, y, dx, 2, size)
    subtract_gram(cov, W, 2, size)
    mirror_robot_block(cov)
    return True


@kernel
def find_duplicate(
    state: Float, cov: Float, size: int, slots: Int, apart: Marks, gate: float, distance: float
) -> tuple[int, int]:
    """Slots of two landmarks, one of them in `slots`, that are statistically one; NOTHING if there are none.

    Their difference d, with covariance C, passes d' C^-1 d <= gate, and is known: three standard deviations
    do not exceed `distance` [m]. Pairs with a mark in `apart` (L, L) are known to be two.
    """
    for a in slots:
        la = 3 + 2 * a
        for b in range((size - 3) // 2):
            lb = 3 + 2 * b
            dx, dy = state[la] - state[lb], state[la + 1] - state[lb + 1]
            if apart[a, b] or a == b or 9.0 * (dx * dx + dy * dy) > gate * distance * distance:
                continue
            low, high = min(la, lb), max(la, lb)
            xx = cov[la, la] + cov[lb, lb] - 2.0 * cov[low, high]
            yy = cov[la + 1, la + 1] + cov[lb + 1, lb + 1] - 2.0 * cov[low + 1, high + 1]
            xy = cov[la, la + 1] + cov[lb, lb + 1] - cov[low, high + 1] - cov[low + 1, high]
            largest = (xx + yy) / 2.0 + (((xx - yy) / 2.0) ** 2 + xy * xy) ** 0.5
            determinant = xx * yy - xy * xy
            if determinant <= 0.0 or 9.0 * largest > distance * distance:
                continue
            if (dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx) / determinant <= gate:
                return a, b
    return NOTHING
