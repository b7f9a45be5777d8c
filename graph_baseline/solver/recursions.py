"""The recursions of the linearised graph from pose to pose, compiled; see `smoother`."""

from __future__ import annotations

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


@kernel
def run_covariances(
    start: Float, F: Float, W: Float, G: Float, P: Float, updated: Float, carry: Float, gain: Float, whitener: Float
) -> None:
    """Fill `P`, `updated` and `whitener`, and of the steps that lead on `carry` and `gain`.

    Gains are whitened twice by the root of the innovations' covariance S. From S^-1 at once they would lose the digits
    by which S is larger in some directions than in others.
    """
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
    """Carry what each scan says back to the poses before it (modified Bryson-Frazier)."""
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
    """Add to each predicted map the one before, carried along."""
    for k in range(len(A) - 1):
        add_product(carry[k], A[k], A[k + 1])
