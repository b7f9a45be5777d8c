"""Changes of the map without observations: remove a landmark, merge two, and find duplicate landmarks, compiled.

Removing marginalises the landmark: its rows and columns are removed, all others stay. Two landmarks are merged by the
noise-free observation l_a - l_b = 0, whose innovation covariance is P_aa + P_bb - P_ab - P_ba. Then one of them is
removed.
"""

from __future__ import annotations

import math

import numpy as np

from slamgauge.arrays import Int, Marks
from slamgauge.ekf.kernels.belief import Belief
from slamgauge.ekf.kernels.linear_update import LinearUpdate, linear_update
from slamgauge.jit import kernel


@kernel
def remove_landmark(belief: Belief, slot: int) -> None:
    """Remove the landmark in `slot`; the last landmark moves into its slot. The caller then reduces the size."""
    state, point, cov = belief.state, belief.point, belief.cov
    to, last = 3 + 2 * slot, belief.size - 2
    belief.points[slot] = belief.points[(last - 3) // 2]
    belief.points[(last - 3) // 2] = True
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
def equate_landmarks(belief: Belief, a: int, b: int) -> LinearUpdate:
    """Update P with the noise-free observation l_a - l_b = 0 of the landmarks in slots a and b; return dx and the NIS.

    If the covariance of the difference is singular, the two are equal already: P is unchanged and the NIS not finite.
    """
    la, lb = 3 + 2 * a, 3 + 2 * b
    columns = np.array([la, la + 1, lb, lb + 1])
    jacobian = np.array([[1.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0]])
    difference = np.array([belief.state[lb] - belief.state[la], belief.state[lb + 1] - belief.state[la + 1]])
    return linear_update(belief, columns, jacobian, difference, np.zeros((2, 2)))


@kernel
def find_duplicates(belief: Belief, slots: Int, apart: Marks, gate: float) -> Int:
    """Return pairs (p, 2) of a landmark in `slots` (s,) and another landmark that may be a duplicate of it.

    Their difference d, with covariance C, passes the test d' C^-1 d <= gate. Pairs marked in `apart` (s, L) are
    different landmarks for certain and are skipped. No eigenvalue of C exceeds the squared sum of both standard
    deviations; this bound excludes most pairs before C is computed.
    """
    state, cov = belief.state, belief.cov
    landmarks = (belief.size - 3) // 2
    found, count = np.empty((len(slots) * landmarks, 2), np.int64), 0
    for i, a in enumerate(slots):
        la = 3 + 2 * a
        own = math.sqrt(cov[la, la] + cov[la + 1, la + 1])
        for b in range(landmarks):
            lb = 3 + 2 * b
            dx, dy = state[la] - state[lb], state[la + 1] - state[lb + 1]
            spread = own + math.sqrt(cov[lb, lb] + cov[lb + 1, lb + 1])
            if apart[i, b] or a == b or dx * dx + dy * dy > gate * spread * spread:
                continue
            low, high = min(la, lb), max(la, lb)
            xx = cov[la, la] + cov[lb, lb] - 2.0 * cov[low, high]
            yy = cov[la + 1, la + 1] + cov[lb + 1, lb + 1] - 2.0 * cov[low + 1, high + 1]
            xy = cov[la, la + 1] + cov[lb, lb + 1] - cov[low, high + 1] - cov[low + 1, high]
            determinant = xx * yy - xy * xy
            if determinant > 0.0 and dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx <= gate * determinant:
                found[count, 0], found[count, 1] = a, b
                count += 1
    return found[:count]
