"""The prediction step, compiled.

Sources: the exercise, equations 1.1 (ENSTA, ROB312, TP4, "SLAM using Extended Kalman Filter"); Sola, "Simultaneous
localization and mapping with the extended Kalman filter" (2014) for the block structure.
"""

from __future__ import annotations

import math

from slamgauge.arrays import Float
from slamgauge.ekf.kernels.belief import Belief
from slamgauge.ekf.kernels.covariance import mirror_robot_block
from slamgauge.ekf.kernels.soundness import is_increment_sound
from slamgauge.formula_kernels import wrap
from slamgauge.jit import inner, kernel


@kernel
def predict(belief: Belief, increment: Float, increment_cov: Float) -> bool:
    """Move the robot by a body-frame increment: P_rr <- F P_rr F' + G Q G', P_rm <- F P_rm.

    F = [I, J lever; 0, 1]; the lever is the vector from the robot's position in `point` to its new position. The
    predicted pose is then copied to `point`. Returns False, with nothing changed, if a value exceeds its limit (see
    `LARGEST`) or Q is not a covariance.
    """
    if not is_increment_sound(increment, increment_cov):
        return False
    state, point, cov = belief.state, belief.point, belief.cov
    c, s = math.cos(state[2]), math.sin(state[2])
    moved_x = c * increment[0] - s * increment[1]
    moved_y = s * increment[0] + c * increment[1]
    lever_x = moved_x + (state[0] - point[0])
    lever_y = moved_y + (state[1] - point[1])
    state[0] += moved_x
    state[1] += moved_y
    state[2] = wrap(state[2] + increment[2])
    point[0], point[1], point[2] = state[0], state[1], state[2]
    # F adds multiples of the heading's row to the position's rows
    for j in range(2, belief.size):
        cov[0, j] -= lever_y * cov[2, j]
        cov[1, j] += lever_x * cov[2, j]
    cov[0, 0] -= lever_y * (cov[2, 0] + cov[0, 2])
    cov[0, 1] += lever_x * cov[0, 2] - lever_y * cov[2, 1]
    cov[1, 1] += lever_x * (cov[2, 1] + cov[1, 2])
    _add_increment_noise(cov, c, s, increment_cov)
    return True


@inner
def _add_increment_noise(cov: Float, c: float, s: float, Q: Float) -> None:
    """Add G Q G' with G = blkdiag(R(heading), 1) to the robot's block, and mirror this block."""
    qx0, qx1, qx2 = c * Q[0, 0] - s * Q[1, 0], c * Q[0, 1] - s * Q[1, 1], c * Q[0, 2] - s * Q[1, 2]
    qy0, qy1, qy2 = s * Q[0, 0] + c * Q[1, 0], s * Q[0, 1] + c * Q[1, 1], s * Q[0, 2] + c * Q[1, 2]
    cov[0, 0] += qx0 * c - qx1 * s
    cov[0, 1] += qx0 * s + qx1 * c
    cov[1, 1] += qy0 * s + qy1 * c
    cov[0, 2] += qx2
    cov[1, 2] += qy2
    cov[2, 2] += Q[2, 2]
    mirror_robot_block(cov)
