"""Blocks and projections of the covariance, compiled; only its upper triangle is stored."""

from __future__ import annotations

import math

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import ROBOT
from slamgauge.jit import inner

TILE = 64  # rows of `cov` that fit into the processor's cache during a strided pass


@inner
def mirror_robot_block(cov: Float) -> None:
    """Copy the upper triangle of the robot's block to its lower triangle."""
    cov[1, 0] = cov[0, 1]
    cov[2, 0] = cov[0, 2]
    cov[2, 1] = cov[1, 2]


@inner
def project_covariance(cov: Float, size: int, slots: Int, jacobian: Float, W: Float) -> None:
    """Compute W[:2m, :size] = H P from the upper triangle of P."""
    for i in range(len(slots)):
        for k in (2 * i, 2 * i + 1):
            h0, h1, h2 = jacobian[k, 0], jacobian[k, 1], jacobian[k, 2]
            for j in range(size):
                W[k, j] = h0 * cov[0, j] + h1 * cov[1, j] + h2 * cov[2, j]
    for first in range(0, size, TILE):
        tile = (first, min(first + TILE, size))
        for i in range(len(slots)):
            _project_landmark(cov, tile, 3 + 2 * slots[i], 2 * i, jacobian, W)


@inner
def _project_landmark(cov: Float, tile: tuple[int, int], landmark: int, k: int, jacobian: Float, W: Float) -> None:
    """Add the landmark's part of H P to rows k and k + 1 of W, in the columns from `tile[0]` to `tile[1]`."""
    first, last = tile
    a3, a4, b3, b4 = jacobian[k, 3], jacobian[k, 4], jacobian[k + 1, 3], jacobian[k + 1, 4]
    above = min(last, landmark)
    for j in range(first, above):
        px, py = cov[j, landmark], cov[j, landmark + 1]
        W[k, j] += a3 * px + a4 * py
        W[k + 1, j] += b3 * px + b4 * py
    for j in range(max(first, landmark), last):
        px = cov[landmark, j]
        py = cov[min(j, landmark + 1), max(j, landmark + 1)]
        W[k, j] += a3 * px + a4 * py
        W[k + 1, j] += b3 * px + b4 * py


@inner
def innovation_covariance(W: Float, slots: Int, jacobian: Float, observation_cov: Float, S: Float) -> None:
    """Compute the upper triangle of S = H P H' + R from W = H P."""
    rows = 2 * len(slots)
    for a in range(rows):
        for b in range(a, rows):
            column = 3 + 2 * slots[b // 2]
            S[a, b] = (
                W[a, 0] * jacobian[b, 0]
                + W[a, 1] * jacobian[b, 1]
                + W[a, 2] * jacobian[b, 2]
                + W[a, column] * jacobian[b, 3]
                + W[a, column + 1] * jacobian[b, 4]
            )
    for i in range(len(slots)):
        k = 2 * i
        r00, r01, r11 = noise(observation_cov[i], jacobian[k + 1])
        S[k, k] += r00
        S[k, k + 1] += r01
        S[k + 1, k + 1] += r11


@inner
def noise(R: Float, second_row: Float) -> tuple[float, float, float]:
    """Return the entries (0, 0), (0, 1) and (1, 1) that an observation's covariance R (2, 2) adds to S.

    Entry (0, 1) is 0 if the bearing has no information, that is if its Jacobian `second_row` (5,) is zero.
    """
    informative = second_row[3] != 0.0 or second_row[4] != 0.0
    return R[0, 0], R[0, 1] if informative else 0.0, R[1, 1]


@inner
def cross_covariance(cov: Float, h_a: Float, a: int, h_b: Float, b: int) -> tuple[float, float, float, float]:
    """Return H_a P H_b' (2, 2), row by row, of observations of the landmarks at entries a and b.

    Their Jacobians (2, 5) are those of `linearisation.linearise`; only the upper triangle of P is used.
    """
    s00, s01, s10, s11 = 0.0, 0.0, 0.0, 0.0
    for k in range(5):
        column = k if k < ROBOT else b + k - ROBOT
        p0, p1 = 0.0, 0.0
        for j in range(5):
            row = j if j < ROBOT else a + j - ROBOT
            p = cov[min(row, column), max(row, column)]
            p0 += h_a[0, j] * p
            p1 += h_a[1, j] * p
        s00 += p0 * h_b[0, k]
        s01 += p0 * h_b[1, k]
        s10 += p1 * h_b[0, k]
        s11 += p1 * h_b[1, k]
    return s00, s01, s10, s11


@inner
def own_covariance(cov: Float, h: Float, landmark: int, R: Float) -> tuple[float, float, float]:
    """Return S = H P H' + R of one observation: entries (0, 0), (0, 1) and (1, 1)."""
    s00, s01, _, s11 = cross_covariance(cov, h, landmark, h, landmark)
    r00, r01, r11 = noise(R, h[1])
    return s00 + r00, s01 + r01, s11 + r11


@inner
def squared_distance(v0: float, v1: float, s00: float, s01: float, s11: float) -> float:
    """Return the squared Mahalanobis distance v' S^-1 v, infinite if S is not positive definite."""
    determinant = s00 * s11 - s01 * s01
    if not determinant > 0.0:
        return math.inf
    return (v0 * v0 * s11 - 2.0 * v0 * v1 * s01 + v1 * v1 * s00) / determinant
