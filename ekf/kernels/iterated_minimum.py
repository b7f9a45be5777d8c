"""The minimum of what a prior and a scan cost together, for the iterated filter.

With P = L L' and x = x^ + L u, half of the cost is f(u) = (u'u + r'r) / 2, where r = T v are the innovations in units
of their noise (T'T = R^-1). P may be singular: L then has columns of zeros. With A = T H L the gradient is g = u - A'r,
and

    B = I + A'A - sum_k q_k L' (d^2 h_k / dx^2) L,    q = R^-1 v

are all second derivatives; Gauss-Newton leaves out the last term. A pass goes from u by -(B + c I)^-1 g, without
damping c if f then decreases by its due share, else with as much as that takes (Levenberg and Marquardt). The first
passes are Gauss-Newton's. Where residuals are large that creeps or swings about the minimum: from there on the last
term is taken along, and the digits double with each pass. The decrement sqrt(g' B^-1 g) is the length of a pass in
standard deviations of what comes out, whatever the units are.

The bearing of what is very close carries no information (see `models`), and a cost that jumps there has no minimum: a
bearing that has once lost its information, where the robot was predicted or on the way, stays without.

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
from slamgauge.jit import kernel
from slamgauge.sensor_kernels import HAS_BEARING

GAUSS_NEWTON = 3  # passes at least before second derivatives are taken along,
PATIENCE = 15  # and at most
NEAR = 1.0  # standard deviations: a decrement at which second derivatives help
SETTLED = 1e-10  # standard deviations: a decrement after which nothing is left to gain
LAST_DIGITS = 1e-6  # standard deviations: below this, what no longer shrinks is rounding
DUE = 1e-4  # share of the decrease that the slope promises
FIRST_DAMPING = 1.0  # what the prior itself adds to B
LEAST_DAMPING = 1.0
LARGEST_DAMPING = 1e20  # nothing is gained with that
FACTOR = 10.0  # of one damping to the next
ROUNDING = 1e-10  # of costs, relative
NOTHING_LEFT = 1e-14  # share of a variance that is rounding


class Seen(NamedTuple):
    """Observations (m,) of landmarks."""

    sensor: int
    slots: Int  # (m,)
    observation: Float  # (m, 2)
    observation_cov: Float  # (m, 2, 2)
    blind: Marks  # (m,) whose bearing has no information


class Terms(NamedTuple):
    """What a pass works with; n entries, m observations."""

    innovation: Float  # (2m,) v
    jacobian: Float  # (2m, 5) H
    r: Float  # (2m,)
    A: Float  # (2m, n)
    B: Float  # (n, n) upper triangle
    F: Float  # (n, n) factor of B + damping
    downhill: Float  # (n,) -g


@kernel
def find_minimum(place: Float, P: Float, seen: Seen, passes: int) -> bool:
    """Move `place` (n,) of robot and landmarks, the prior's mean with covariance P (n, n), to the minimum.

    Which bearings have lost their information on the way stands in `seen.blind`. Returns False where the minimum was
    not reached.
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
        u[:] = tried
        cost = there
        _note_blind(seen, terms)
        if damping > 0.0:
            damping = damping / FACTOR if damping > LEAST_DAMPING else 0.0
            last = math.inf
            continue
        ahead = decrement * (decrement / last)  # of the next pass, where they shrink evenly
        if decrement < SETTLED or (last < math.inf and ahead < SETTLED and decrement < 0.1 * last):
            return True
        if exact and decrement < LAST_DIGITS and decrement > 0.25 * last:
            return True
        last = decrement
    return False


@kernel
def square_root(P: Float) -> Float:
    """L (n, n), lower, with L L' = P; a column is zero where nothing but rounding is left of its variance."""
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


@kernel
def misfit(place: Float, seen: Seen, terms: Terms) -> float:
    """Linearise at a place; r in `terms`, and half of r'r."""
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


@kernel
def silence(blind: Marks, innovation: Float, jacobian: Float) -> None:
    """Take the information from the bearings of the marked observations."""
    for i in range(len(blind)):
        if blind[i]:
            innovation[2 * i + 1] = 0.0
            jacobian[2 * i + 1] = 0.0


@kernel
def _note_blind(seen: Seen, terms: Terms) -> None:
    """Mark the observations whose bearing has no information where `misfit` has been."""
    for i in range(len(seen.blind)):
        second_row = terms.jacobian[2 * i + 1]
        if second_row[3] == 0.0 and second_row[4] == 0.0:
            seen.blind[i] = True


@kernel
def _whitener(R: Float, second_row: Float) -> tuple[float, float, float]:
    """T (2, 2), lower, with T'T = R^-1: its entries (0, 0), (1, 0) and (1, 1)."""
    r00, r01, r11 = noise(R, second_row)
    u00 = math.sqrt(r00)
    u01 = r01 / u00
    u11 = math.sqrt(r11 - u01 * u01)
    return 1.0 / u00, -u01 / (u00 * u11), 1.0 / u11


@kernel
def _move(place: Float, mean: Float, L: Float, u: Float) -> None:
    """Place <- mean + L u."""
    for i in range(len(place)):
        total = 0.0
        for j in range(i + 1):
            total += L[i, j] * u[j]
        place[i] = mean[i] + total


@kernel
def _expand(place: Float, L: Float, u: Float, seen: Seen, terms: Terms, exact: bool) -> bool:
    """B and -g in `terms` where `misfit` has been; False if they are not finite."""
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


@kernel
def _direction(terms: Terms, damping: float, step: Float) -> float:
    """Step <- -(B + damping I)^-1 g; returns the decrement, infinite where there is none."""
    size, F = len(step), terms.F
    F[:] = terms.B
    for j in range(size):
        F[j, j] += damping
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


@kernel
def _project(L: Float, seen: Seen, terms: Terms) -> None:
    """A = T H L."""
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


@kernel
def _add_gram(B: Float, A: Float) -> None:
    """B = I + A'A, its upper triangle."""
    size = len(B)
    B[:] = 0.0
    for j in range(size):
        B[j, j] = -1.0
    subtract_gram(B, A, len(A), size)
    for a in range(size):
        for b in range(a, size):
            B[a, b] = -B[a, b]


@kernel
def _subtract_curvature(place: Float, L: Float, seen: Seen, terms: Terms) -> None:
    """B <- B - sum_k q_k L' (d^2 h_k / dx^2) L.

    In e = landmark - robot and the heading alone: a range bends with e, a bearing too, and is linear in the heading; a
    position in the body frame bends with the heading, and with heading and e.
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
