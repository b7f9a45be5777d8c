"""The linearised graph solved through its Schur complement: the step, and every covariance.

Given the landmarks m, the poses are a Markov chain, and everything about them is affine in m. One pass
forward (a Kalman filter whose mean is the 3 x (2L + 1) matrix of that affine map) gathers the landmarks'
information Lambda, the Schur complement of the poses; one pass back (modified Bryson-Frazier, which
inverts no covariance) smooths the chain. Then cov(m) = Lambda^-1, cov(x_k) = P_k + A_k Lambda^-1 A_k'.
Singular motion noise and a fixed start are exact: no covariance of a pose is ever inverted.

A scan of m observations meets its pose through three numbers only, so it is first compressed to three
equations G dx + X dm + g = unit noise; what else it says is about its landmarks alone.

Cost: O(N L^2) in two symmetric products; no matrix larger than (3N, 2L).
Source: Bierman, "Factorization methods for discrete sequential estimation" (1977), chapter X.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from graph_baseline.linearisation import LinearModel
from slam2d import Float

CHUNK = 512  # steps whose rows are gathered in one symmetric product


class Solution(NamedTuple):
    """Newton step and covariances of the linearised problem, additive world coordinates."""

    dx: Float  # (N+1, 3)
    dm: Float  # (L, 2)
    pose_covs: Float  # (N+1, 3, 3)
    landmark_covs: Float  # (L, 2, 2)


class _Scans(NamedTuple):
    """Compressed scans: G dx + X dm + g = unit noise, and the landmarks' remaining information."""

    G: Float  # (N+1, 3, 3)
    X: Float  # (M, 3, 2)
    g: Float  # (N+1, 3)
    information: Float  # (2L, 2L)
    vector: Float  # (2L,)


def solve(model: LinearModel, landmarks: int) -> Solution:
    """Minimise the linear model over all poses and `landmarks` landmarks.

    Raises:
        numpy.linalg.LinAlgError: the observations do not determine the landmarks.
    """
    scans = _compress(model, landmarks)
    A, P, rows = _forward(model, scans, landmarks)
    Lambda, vector = scans.information, scans.vector
    for first in range(0, len(rows), CHUNK):
        chunk = rows[first : first + CHUNK].reshape(-1, rows.shape[2])
        Lambda += chunk[:, :-1].T @ chunk[:, :-1]
        vector += chunk[:, :-1].T @ chunk[:, -1]
    factor = np.linalg.cholesky(Lambda)
    dm = -cho_solve((factor, True), vector)
    _backward(model, scans, A, P, rows)
    dx = A[:, :, :-1] @ dm + A[:, :, -1]
    spread = solve_triangular(factor, A[:, :, :-1].reshape(-1, 2 * landmarks).T, lower=True, check_finite=False)
    spread = spread.T.reshape(len(A), 3, 2 * landmarks)
    pose_covs = P + spread @ spread.swapaxes(1, 2)
    covariance = cho_solve((factor, True), np.eye(2 * landmarks)).reshape(landmarks, 2, landmarks, 2)
    own = np.arange(landmarks)
    return Solution(dx, dm.reshape(-1, 2), pose_covs, covariance[own, :, own, :])


def _compress(model: LinearModel, landmarks: int) -> _Scans:
    poses = len(model.F) + 1
    information = np.zeros((poses, 3, 3))
    np.add.at(information, model.step, model.Hx.swapaxes(1, 2) @ model.Hx)
    vector = np.zeros((poses, 3))
    np.add.at(vector, model.step, np.einsum("mij,mi->mj", model.Hx, model.r))
    value, axes = np.linalg.eigh(information)
    value[value < 1e-13 * value[:, -1:]] = 0.0
    root = np.sqrt(value)
    inverse = np.divide(1.0, root, out=np.zeros_like(root), where=root > 0)
    G = root[:, :, None] * axes.swapaxes(1, 2)
    to_rows = inverse[:, :, None] * axes.swapaxes(1, 2)
    g = np.einsum("nij,nj->ni", to_rows, vector)
    X = to_rows[model.step] @ (model.Hx.swapaxes(1, 2) @ model.Hm)

    own = np.zeros((landmarks, 2, 2))
    np.add.at(own, model.slot, model.Hm.swapaxes(1, 2) @ model.Hm)
    remaining = np.zeros((landmarks, 2, landmarks, 2))
    index = np.arange(landmarks)
    remaining[index, :, index, :] = own
    remaining = remaining.reshape(2 * landmarks, 2 * landmarks)
    own_vector = np.zeros((landmarks, 2))
    np.add.at(own_vector, model.slot, np.einsum("mij,mi->mj", model.Hm, model.r))
    remaining_vector = own_vector.ravel()
    for first in range(0, poses, CHUNK):
        last = min(first + CHUNK, poses)
        rows = np.zeros((last - first, 3, landmarks, 2))
        begin, end = np.searchsorted(model.step, [first, last])
        np.add.at(rows.swapaxes(1, 2), (model.step[begin:end] - first, model.slot[begin:end]), X[begin:end])
        flat = rows.reshape(-1, 2 * landmarks)
        remaining -= flat.T @ flat
        remaining_vector -= flat.T @ g[first:last].ravel()
    return _Scans(G, X, g, remaining, remaining_vector)


def _forward(model: LinearModel, scans: _Scans, landmarks: int) -> tuple[Float, Float, Float]:
    """Predicted affine maps A (N+1, 3, 2L+1) and covariances P (N+1, 3, 3), whitened innovations."""
    poses, width = len(model.F) + 1, 2 * landmarks + 1
    A, P, rows = np.zeros((poses, 3, width)), np.empty((poses, 3, 3)), np.empty((poses, 3, width))
    A[0, :, -1], P[0] = model.start, model.start_cov
    bounds = np.searchsorted(model.step, np.arange(poses + 1)).tolist()
    identity = np.eye(3)
    for k in range(poses):
        G = scans.G[k]
        innovation = G @ A[k]
        begin, end = bounds[k], bounds[k + 1]
        by_landmark = innovation[:, :-1].reshape(3, landmarks, 2).swapaxes(0, 1)
        np.add.at(by_landmark, model.slot[begin:end], scans.X[begin:end])
        innovation[:, -1] += scans.g[k]
        lower_inverse = np.linalg.inv(np.linalg.cholesky(identity + G @ P[k] @ G.T))
        rows[k] = lower_inverse @ innovation
        if k + 1 < poses:
            gain = P[k] @ (lower_inverse @ G).T
            F = model.F[k]
            A[k + 1] = F @ (A[k] - gain @ rows[k])
            A[k + 1, :, -1] += model.c[k]
            P[k + 1] = F @ (P[k] - gain @ gain.T) @ F.T + model.W[k]
    return A, P, rows


def _backward(model: LinearModel, scans: _Scans, A: Float, P: Float, rows: Float) -> None:
    """Replace predicted maps A and covariances P by smoothed ones, in place."""
    poses = len(A)
    adjoint, adjoint_cov = np.zeros_like(A[0]), np.zeros((3, 3))
    identity = np.eye(3)
    for k in range(poses - 1, -1, -1):
        G = scans.G[k]
        whitened = np.linalg.inv(np.linalg.cholesky(identity + G @ P[k] @ G.T)) @ G
        carry = identity - P[k] @ whitened.T @ whitened  # I - K G
        adjoint = whitened.T @ rows[k] + carry.T @ adjoint
        adjoint_cov = whitened.T @ whitened + carry.T @ adjoint_cov @ carry
        A[k] -= P[k] @ adjoint
        smoothed = P[k] - P[k] @ adjoint_cov @ P[k]
        P[k] = (smoothed + smoothed.T) / 2
        if k:
            adjoint = model.F[k - 1].T @ adjoint
            adjoint_cov = model.F[k - 1].T @ adjoint_cov @ model.F[k - 1]
