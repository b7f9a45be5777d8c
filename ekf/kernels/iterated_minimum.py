"""Minimum of the cost of a prior and a scan, for the iterated filter, compiled.

With P = L L' and x = x^ + L u, half of the cost is f(u) = (u'u + r'r) / 2, where r = T v are the whitened innovations
(T'T = R^-1). P may be singular: L then has columns of zeros. With A = T H L the gradient is g = u - A'r, and the
Hessian is

    B = I + A'A - sum_k q_k L' (d^2 h_k / dx^2) L,    q = R^-1 v

Gauss-Newton omits the last term. A pass changes u by -(B + c I)^-1 g. The damping c is zero if f then decreases
enough, else it grows until f does (Levenberg and Marquardt). The first passes are Gauss-Newton. With large residuals
these converge slowly or oscillate about the minimum, so later passes include the last term and converge
quadratically. The decrement sqrt(g' B^-1 g) is the length of a pass in standard deviations of the result, which does
not depend on the units.

The bearing of a very close landmark has no information (see `slamgauge.sensor_kernels`). The cost would jump there and
have no minimum. Therefore a bearing that has lost its information at one iterate is ignored in all later ones.

Source: Nocedal and Wright, Numerical Optimization (2006), section 10.3.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels.belief import AT_POINT, Belief
from slamgauge.ekf.kernels.blas import add_outer_pair, cholesky, subtract_gram
from slamgauge.ekf.kernels.covariance import noise
from slamgauge.ekf.kernels.linearisation import linearise
from slamgauge.jit import inner
from slamgauge.sensor_kernels import HAS_BEARING

GAUSS_NEWTON = 3  # smallest number of Gauss-Newton passes
PATIENCE = 15  # largest number of Gauss-Newton passes
NEAR = 1.0  # decrement below which the full Hessian is used [standard deviations]
SETTLED = 1e-10  # decrement at which the minimum is reached [standard deviations]
LAST_DIGITS = 1e-6  # below this a decrement that no longer shrinks is rounding [standard deviations]
DUE = 1e-4  # required share of the decrease that the slope predicts (Armijo's condition)
FIRST_DAMPING = 1.0  # equal to the prior's part of B
LEAST_DAMPING = 1.0
LARGEST_DAMPING = 1e20  # the search ends without a decrease
FACTOR = 10.0  # ratio of one damping to the next
ROUNDING = 1e-10  # relative rounding error of costs
NOTHING_LEFT = 1e-14  # share of a variance that is rounding


class Seen(NamedTuple):
    """Observations (m,) of landmarks."""

    sensor: int
    slots: Int  # (m,)
    observation: Float  # (m, 2)
    observation_cov: Float  # (m, 2, 2)
    blind: Marks  # (m,) True if the bearing has no information


class Terms(NamedTuple):
    """Arrays of a pass, for n entries and m observations."""

    innovation: Float  # (2m,) v
    jacobian: Float  # (2m, 5) H
    r: Float  # (2m,) T v
    A: Float  # (2m, n) T H L
    B: Float  # (n, n) upper triangle
    F: Float  # (n, n) Cholesky factor of B + damping I
    downhill: Float  # (n,) -g


@inner
def find_minimum(place: Float, P: Float, seen: Seen, passes: int) -> bool:
    """Move `place` (n,), robot and landmarks, from the prior's mean with covariance P (n, n) to the minimum.

    Marks the bearings that lose their information in `seen.blind`. Returns False if the minimum was not reached.
    """
    size, rows = len(place), 2 * len(seen.slots)
    L, mean = square_root(P), place.copy()
    u, tried, step = np.zeros(size), np.zeros(size), np.zeros(size)
    terms = Terms(
        np.empty(rows),
        np.empty((rows, 5)),
        np.empty(rows),
        np.empty((rows, size)),
        np.empty((size, size)),
        np.empty((size, size)),
        np.empty(size),
    )
    cost, last, damping = misfit(place, seen, terms), math.inf, 0.0
    _note_blind(seen, terms)
    for iteration in range(passes):
        exact = iteration >= PATIENCE or (iteration >= GAUSS_NEWTON and last < NEAR)
        if not _expand(place, L, u, seen, terms, exact):
            return False
        while True:
            decrement = _direction(terms, damping, step)
            for j in range(size):
                tried[j] = u[j] + step[j]
            _move(place, mean, L, tried)
            there = misfit(place, seen, terms) + 0.5 * np.dot(tried, tried)
            due = DUE * (decrement * decrement + damping * np.dot(step, step))
            if there <= cost - due + ROUNDING * (1.0 + cost):
                break
            damping = max(FACTOR * damping, FIRST_DAMPING)
            if not damping < LARGEST_DAMPING:
                _move(place, mean, L, u)
                return _direction(terms, 0.0, step) < LAST_DIGITS
        for j in range(size):
            u[j] = tried[j]
        cost = there
        _note_blind(seen, terms)
        if damping > 0.0:
            damping = damping / FACTOR if damping > LEAST_DAMPING else 0.0
            last = math.inf
            continue
        ahead = decrement * (decrement / last)  # next decrement if the convergence is linear
        if decrement < SETTLED or (last < math.inf and ahead < SETTLED and decrement < 0.1 * last):
            return True
        if exact and decrement < LAST_DIGITS and decrement > 0.25 * last:
            return True
        last = decrement
    return False


@inner
def square_root(P: Float) -> Float:
    """Return lower triangular L (n, n) with L L' = P; a column is zero if its remaining variance is rounding."""
    size = len(P)
    L = np.zeros((size, size))
    for j in range(size):
        left = P[j, j]
        for k in range(j):
            left -= L[j, k] * L[j, k]
        if not left > NOTHING_LEFT * P[j, j]:
            continue
        L[j, j] = math.sqrt(left)
        for i in range(j + 1, size):
            entry = P[i, j]
            for k in range(j):
                entry -= L[i, k] * L[j, k]
            L[i, j] = entry / L[j, j]
    return L


@inner
def misfit(place: Float, seen: Seen, terms: Terms) -> float:
    """Linearise at `place` and fill `terms`; return half of r'r."""
    marks = np.ones(len(place) // 2, dtype=np.bool_)
    there = Belief(place, place, terms.B, marks, len(place), AT_POINT)
    linearise(seen.sensor, there, seen.slots, seen.observation, terms.innovation, terms.jacobian)
    silence(seen.blind, terms.innovation, terms.jacobian)
    v, r, total = terms.innovation, terms.r, 0.0
    for i in range(len(seen.slots)):
        t00, t10, t11 = _whitener(seen.observation_cov[i], terms.jacobian[2 * i + 1])
        r[2 * i] = t00 * v[2 * i]
        r[2 * i + 1] = t10 * v[2 * i] + t11 * v[2 * i + 1]
        total += r[2 * i] * r[2 * i] + r[2 * i + 1] * r[2 * i + 1]
    return 0.5 * total


@inner
def silence(blind: Marks, innovation: Float, jacobian: Float) -> None:
    """Set innovation and Jacobian of the bearings marked in `blind` to zero."""
    for i in range(len(blind)):
        if blind[i]:
            innovation[2 * i + 1] = 0.0
            jacobian[2 * i + 1] = 0.0


@inner
def _note_blind(seen: Seen, terms: Terms) -> None:
    """Mark the observations whose bearing has no information at the place of the last `misfit`."""
    for i in range(len(seen.blind)):
        second_row = terms.jacobian[2 * i + 1]
        if second_row[3] == 0.0 and second_row[4] == 0.0:
            seen.blind[i] = True


@inner
def _whitener(R: Float, second_row: Float) -> tuple[float, float, float]:
    """Return entries (0, 0), (1, 0) and (1, 1) of lower triangular T (2, 2) with T'T = R^-1."""
    r00, r01, r11 = noise(R, second_row)
    u00 = math.sqrt(r00)
    u01 = r01 / u00
    u11 = math.sqrt(r11 - u01 * u01)
    return 1.0 / u00, -u01 / (u00 * u11), 1.0 / u11


@inner
def _move(place: Float, mean: Float, L: Float, u: Float) -> None:
    """Set `place` to mean + L u."""
    for i in range(len(place)):
        total = 0.0
        for j in range(i + 1):
            total += L[i, j] * u[j]
        place[i] = mean[i] + total


@inner
def _expand(place: Float, L: Float, u: Float, seen: Seen, terms: Terms, exact: bool) -> bool:
    """Fill B and -g of `terms` at the place of the last `misfit`; return False if they are not finite."""
    size, B, A = len(place), terms.B, terms.A
    _project(L, seen, terms)
    _add_gram(B, A)
    if exact:
        _subtract_curvature(place, L, seen, terms)
    downhill = terms.downhill
    for j in range(size):
        downhill[j] = -u[j]
    for k in range(len(A)):
        for j in range(size):
            downhill[j] += A[k, j] * terms.r[k]
    return math.isfinite(np.sum(downhill)) and math.isfinite(np.sum(B))


@inner
def _direction(terms: Terms, damping: float, step: Float) -> float:
    """Set `step` to -(B + damping I)^-1 g; return the decrement, infinite if the matrix is not positive definite."""
    size, F = len(step), terms.F
    for i in range(size):
        for j in range(size):
            F[i, j] = terms.B[i, j]
        F[i, i] += damping
    if not cholesky(F, size):
        return math.inf
    squared = 0.0
    for a in range(size):  # F = U'U
        step[a] = terms.downhill[a]
        for b in range(a):
            step[a] -= F[b, a] * step[b]
        step[a] /= F[a, a]
        squared += step[a] * step[a]
    for a in range(size - 1, -1, -1):
        for b in range(a + 1, size):
            step[a] -= F[a, b] * step[b]
        step[a] /= F[a, a]
    return math.sqrt(squared)


@inner
def _project(L: Float, seen: Seen, terms: Terms) -> None:
    """Compute A = T H L."""
    H, A = terms.jacobian, terms.A
    for i in range(len(seen.slots)):
        k, landmark = 2 * i, 3 + 2 * seen.slots[i]
        t00, t10, t11 = _whitener(seen.observation_cov[i], H[k + 1])
        for j in range(A.shape[1]):
            first = H[k, 0] * L[0, j] + H[k, 1] * L[1, j] + H[k, 2] * L[2, j]
            first += H[k, 3] * L[landmark, j] + H[k, 4] * L[landmark + 1, j]
            second = H[k + 1, 0] * L[0, j] + H[k + 1, 1] * L[1, j] + H[k + 1, 2] * L[2, j]
            second += H[k + 1, 3] * L[landmark, j] + H[k + 1, 4] * L[landmark + 1, j]
            A[k, j] = t00 * first
            A[k + 1, j] = t10 * first + t11 * second


@inner
def _add_gram(B: Float, A: Float) -> None:
    """Compute the upper triangle of B = I + A'A."""
    size = len(B)
    B[:] = 0.0
    for j in range(size):
        B[j, j] = -1.0
    subtract_gram(B, A, len(A), size)
    for a in range(size):
        for b in range(a, size):
            B[a, b] = -B[a, b]


@inner
def _subtract_curvature(place: Float, L: Float, seen: Seen, terms: Terms) -> None:
    """B <- B - sum_k q_k L' (d^2 h_k / dx^2) L.

    The derivatives are those by the heading and by e = landmark - robot. For range and bearing only the derivatives by
    e twice differ from zero; for a position in the body frame those by the heading twice, and by heading and e.
    """
    size, v = len(place), terms.innovation
    one, other, ex_row, ey_row = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    c, s = math.cos(place[2]), math.sin(place[2])
    for i in range(len(seen.slots)):
        landmark = 3 + 2 * seen.slots[i]
        r00, r01, r11 = noise(seen.observation_cov[i], terms.jacobian[2 * i + 1])
        determinant = r00 * r11 - r01 * r01
        q0 = (r11 * v[2 * i] - r01 * v[2 * i + 1]) / determinant
        q1 = (r00 * v[2 * i + 1] - r01 * v[2 * i]) / determinant
        ex, ey = place[landmark] - place[0], place[landmark + 1] - place[1]
        for j in range(size):
            ex_row[j], ey_row[j] = L[landmark, j] - L[0, j], L[landmark + 1, j] - L[1, j]
        if not HAS_BEARING[seen.sensor]:
            turning = -0.5 * (q0 * (c * ex + s * ey) + q1 * (c * ey - s * ex))
            tx, ty = -s * q0 - c * q1, c * q0 - s * q1
            for j in range(size):
                one[j] = L[2, j]
                other[j] = -(turning * L[2, j] + tx * ex_row[j] + ty * ey_row[j])
            add_outer_pair(terms.B, one, other, size)
            continue
        squared = ex * ex + ey * ey
        if squared == 0.0:
            continue
        along, across = q0 / (squared * math.sqrt(squared)), q1 / (squared * squared)
        xx = along * ey * ey + across * 2.0 * ex * ey
        xy = -along * ex * ey + across * (ey * ey - ex * ex)
        yy = along * ex * ex - across * 2.0 * ex * ey
        for j in range(size):
            other[j] = -(0.5 * xx * ex_row[j] + xy * ey_row[j])
            one[j] = -0.5 * yy * ey_row[j]
        add_outer_pair(terms.B, ex_row, other, size)
        add_outer_pair(terms.B, ey_row, one, size)
