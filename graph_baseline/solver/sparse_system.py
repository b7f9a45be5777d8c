"""Step and covariances of a linearised graph with a large map, by a sparse factorisation (SuperLU).

`smoother` eliminates the poses, which leaves a dense matrix of all landmarks. Here the landmarks are eliminated. With
D = Hm' Hm and J = D^-1 Hm' Hx, the poses x and the multipliers p of the motions G x = c + w, w ~ N(0, W), solve

    [ Hx' Hx - J' D J    G' ] [x]   [ J' Hm' r - Hx' r ]
    [ G                  -W ] [p] = [ c                ],    and the landmarks are m = -J x - D^-1 Hm' r.

W is not inverted, so motions of zero variance are exact. The covariance C of the poses is the upper left block of the
inverse of this matrix, and that of the landmarks is D^-1 + J C J'.

Source: Bjorck, "Numerical methods for least squares problems", 1996 (augmented systems).
"""

from __future__ import annotations

import numpy as np
from numpy.linalg import LinAlgError
from scipy.sparse import block_array, bsr_array, diags_array, eye_array
from scipy.sparse.linalg import splu

from slamgauge.arrays import Float
from slamgauge.covariances import inverted, without_negative_eigenvalues
from slamgauge.graph_baseline.problem.linearisation import LinearModel, Scans

COLUMNS = 192  # computed together for the inverse; a multiple of 3; with 10 000 landmarks they take 100 MB
LOST_DETERMINANT = 1e-12  # a determinant of D below this share of the product of its diagonal is rounding


class SparseSystem:
    """A factorised linear model in which every observation has a landmark; the damping is that of `smoother.Damping`.

    Raises:
        numpy.linalg.LinAlgError: the observations do not determine the landmarks.
    """

    def __init__(
        self, model: LinearModel, scans: Scans, landmarks: int, pose_damping: Float, landmark_damping: float
    ) -> None:
        poses, bounds, r = np.arange(len(model.c)), np.arange(len(model.r) + 1), model.r.ravel()
        seen = np.diff(scans.first)
        Hx = bsr_array((model.Hx, np.repeat(poses, seen), bounds), shape=(r.size, model.c.size))
        Hm = bsr_array((model.Hm, scans.slot, bounds), shape=(r.size, 2 * landmarks))
        D = np.tile(landmark_damping * np.eye(2), (landmarks, 1, 1))
        np.add.at(D, scans.slot, model.Hm.swapaxes(1, 2) @ model.Hm)
        if not (np.linalg.det(D) > LOST_DETERMINANT * D[:, 0, 0] * D[:, 1, 1]).all():
            raise LinAlgError("the information of a landmark is rounding")
        self._inverse = inverted(D)
        slots = np.arange(landmarks + 1)
        self._J = (bsr_array((self._inverse, slots[:-1], slots)) @ (Hm.T @ Hx)).tocsc()
        damping = diags_array(np.outer(seen > 0, pose_damping).ravel())
        before = np.tile(np.eye(3), (len(poses) - 1, 1, 1))
        before[:, :2, 2] = model.lever[1:]
        G = eye_array(model.c.size) - bsr_array((before, poses[:-1], np.append(0, poses)), shape=damping.shape)
        W = bsr_array((model.W, poses, np.append(poses, len(poses))))
        information = Hx.T @ Hx + damping - self._J.T @ (Hm.T @ Hx)
        try:
            self._factors = splu(block_array([[information, G.T], [G, -W]], format="csc"))
        except RuntimeError as error:  # SuperLU found a pivot of zero
            raise LinAlgError(str(error)) from None
        gradient = Hm.T @ r
        self._right = np.concatenate([self._J.T @ gradient - Hx.T @ r, model.c.ravel()])
        self._offset = self._inverse @ gradient.reshape(-1, 2, 1)

    def step(self) -> tuple[Float, Float]:
        """Return the step of all poses (N+1, 3) and landmarks (L, 2)."""
        dx = self._factors.solve(self._right)[: self._J.shape[1]]
        return dx.reshape(-1, 3), -(self._J @ dx).reshape(-1, 2) - self._offset[:, :, 0]

    def covariances(self) -> tuple[Float, Float]:
        """Return the covariances of all poses (N+1, 3, 3) and landmarks (L, 2, 2)."""
        size, landmark_covs = self._J.shape[1], self._inverse.copy()
        pose_covs = np.empty((size // 3, 3, 3))
        for first in range(0, size, COLUMNS):
            end = min(first + COLUMNS, size)
            C = self._factors.solve(np.eye(2 * size, end - first, -first))[:size]
            own = np.arange((end - first) // 3)
            pose_covs[first // 3 : end // 3] = C[first:end].reshape(len(own), 3, len(own), 3)[own, :, own]
            spread, by_pose = self._J @ C, self._J[:, first:end].toarray()
            landmark_covs += spread.reshape(-1, 2, end - first) @ by_pose.reshape(-1, 2, end - first).swapaxes(1, 2)
        return without_negative_eigenvalues(pose_covs), without_negative_eigenvalues(landmark_covs)
