"""Two retractions of a linear step, equal to first order.

They differ if a step bends the path strongly: `retract_pointwise` moves each pose by its step, `retract_by_motions`
changes each motion by a small amount. The solver uses the result with the lower cost.
"""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float
from slamgauge.graph_baseline.problem.constrained_motion import MotionNoise
from slamgauge.graph_baseline.problem.linearisation import LinearModel
from slamgauge.se2 import exp, right_jacobian, rotation, wrap


def retract_pointwise(
    model: LinearModel, noise: MotionNoise, poses: Float, landmarks: Float, dx: Float, dm: Float
) -> tuple[Float, Float]:
    """Return path and map after a step (N+1, 3), (L, 2): each point moves by V(turn) step, V(t) = (R(t) - I) / (t J).

    A rotation of all points about a common centre then keeps all distances; an additive step would stretch them. The
    turn of a landmark is the mean turn of the poses that observe it.
    """
    turn = dx[:, 2]
    seen = np.maximum(np.bincount(model.slot, minlength=len(dm)), 1)
    turn_of_landmark = np.bincount(model.slot, turn[model.step], minlength=len(dm)) / seen
    path = np.column_stack([poses[:, :2] + exp(dx)[:, :2], wrap(poses[:, 2] + turn)])
    return noise.satisfying_constraints(path), landmarks + exp(np.column_stack([dm, turn_of_landmark]))[:, :2]


def retract_by_motions(
    model: LinearModel, noise: MotionNoise, poses: Float, landmarks: Float, dx: Float, dm: Float
) -> tuple[Float, Float]:
    """Return path and map after a step (N+1, 3), (L, 2) that changes the residuals of the motions.

    A turn of one motion rotates all later poses. A landmark moves with the pose of its first observation, plus its step
    relative to this pose.
    """
    change = dx.copy()
    change[1:] -= np.einsum("nij,nj->ni", model.F, dx[:-1])
    change[:, :2] = np.einsum("nji,nj->ni", rotation(poses[:, 2]), change[:, :2])
    residual = noise.residuals(poses)
    path = noise.path(residual + np.linalg.solve(right_jacobian(residual), change[:, :, None])[:, :, 0])
    at = model.step[np.unique(model.slot, return_index=True)[1]]
    offset = landmarks - poses[at, :2]
    across = np.column_stack([-offset[:, 1], offset[:, 0]])
    offset += dm - dx[at, :2] - across * dx[at, 2:]
    turn = rotation(path[at, 2] - poses[at, 2])
    return path, path[at, :2] + np.einsum("nij,nj->ni", turn, offset)
