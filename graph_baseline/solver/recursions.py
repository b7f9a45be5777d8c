"""Recursions along the chain of poses of a linearised graph, compiled; see `smoother`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.graph_baseline.solver.matrices_3x3 import (
    add_identity,
    add_product,
    copy,
    factorise,
    invert_factor,
    product,
    product_transposed,
    symmetrise,
)
from slamgauge.jit import kernel


class FilterCovariances(NamedTuple):
    """Covariances and gains of the Kalman filter of a pose given the unknowns."""

    P: Float  # (N+1, 3, 3) predicted covariances
    updated: Float  # (N+1, 3, 3) updated covariances
    carry: Float  # (N+1, 3, 3) F (I - K G)
    gain: Float  # (N+1, 3, 3) F K
    whitener: Float  # (N+1, 3, 3) L^-1 of the innovation covariance L L'


@kernel
def run_covariances(start: Float, F: Float, W: Float, G: Float, out: FilterCovariances) -> None:
    """Run the filter from the covariance `start` (3, 3) over scans G (N+1, 3, 3); fill `out`.

    The last `carry` and `gain` are not filled. Gains are multiplied twice by the whitener, because the inverse of an
    innovation covariance S with very different eigenvalues would lose digits.
    """
    P, updated, carry, gain, whitener = out
    PG, S, V, K = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    copy(start, P[0])
    for k in range(len(G)):
        product_transposed(P[k], G[k], PG)
        product(G[k], PG, S)
        add_identity(S)
        factorise(S)
        invert_factor(S, whitener[k])
        product_transposed(PG, whitener[k], V)
        product_transposed(V, V, updated[k])
        for i in range(3):
            for j in range(3):
                updated[k, i, j] = P[k, i, j] - updated[k, i, j]
        if k == len(F):
            return
        product(V, whitener[k], K)
        product(F[k], K, gain[k])
        product(gain[k], G[k], carry[k])
        product(F[k], updated[k], S)
        product_transposed(S, F[k], P[k + 1])
        for i in range(3):
            for j in range(3):
                carry[k, i, j] = F[k, i, j] - carry[k, i, j]
                P[k + 1, i, j] += W[k, i, j]
        symmetrise(P[k + 1])


@kernel
def run_adjoints(carry: Float, adjoint: Float, adjoint_cov: Float) -> None:
    """Propagate the adjoints of each scan back to earlier poses (modified Bryson-Frazier smoother)."""
    back, half = np.empty((3, 3)), np.empty((3, 3))
    for k in range(len(carry) - 2, -1, -1):
        for i in range(3):
            for j in range(3):
                back[i, j] = carry[k, j, i]
        add_product(back, adjoint[k + 1], adjoint[k])
        product(back, adjoint_cov[k + 1], half)
        add_product(half, carry[k], adjoint_cov[k])


@kernel
def run_maps(carry: Float, A: Float) -> None:
    """Add to each map A[k + 1] the propagated map carry[k] A[k]."""
    for k in range(len(A) - 1):
        add_product(carry[k], A[k], A[k + 1])
