"""What tells the filters apart: how the innovations of a step correct the state and its covariance.

All start from the same additive correction, which `kernels.joint_update` makes of a scan: dx = W'y and
P <- P - W'W, with the factor W of the gain and the whitened innovation y.

The first-estimates filter is the standard one with Jacobians at another `point`: where a landmark was
first put, and where the robot was last predicted. Turn and shift of the whole map then stay unobservable,
as H F...F N = 0 for N = [I, J p; 0, 1; I, J l]. It leans on good first estimates.

The observability-constrained filter predicts with the same F, and so keeps the same N. Its H is taken at the newest
estimate and then projected: the nearest matrix in Frobenius norm with H N = 0 (`linearisation.project_on_observable`).

The iterated filter takes its Jacobians where its own correction leads, until that place stands still: see
`kernels.iterated_update`.

The right-invariant filter needs no other coordinates than these. Its error xi, with
theta = theta^ + xi_theta and p = R(xi_theta) p^ + V(xi_theta) xi_p (landmarks likewise), is
xi = D^-1 (additive error), D = [I, J p; 0, 1] with landmark rows [I, J l]. Written out:

* prediction, Jacobians and new landmarks are those of the standard filter, D F D^-1 and so on;
* because V(t) t J = R(t) - I, the retraction exp(xi) moves every point by V(dtheta) dx alone;
* D changes with the estimate, so after the correction the covariance is carried along:
  P <- T P T' with T = D(after) D(before)^-1 = I + u e_theta', u = J (after - before) for positions.

That last step is a symmetric rank-2 change. It is what keeps the unobservable directions (shift and
turn of the whole map) unobservable: the standard filter leaves P at the old estimate.

Sources: Huang, Mourikis and Roumeliotis, IJRR 29(5), 2010 (first estimates, observability constraints), with the
projection of Hesch, Kottas, Bowman and Roumeliotis, IJRR 33(1), 2014; Bell and Cathey, IEEE
Transactions on Automatic Control 38(2), 1993 (iterated); Barrau and Bonnabel, arXiv 1510.06263 (2015)
and Zhang et al., RA-L 2017 (right-invariant).
"""

from __future__ import annotations

import math

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf.kernels.belief import Belief
from slamgauge.ekf.kernels.blas import add_outer_pair
from slamgauge.ekf.kernels.covariance import mirror_robot_block
from slamgauge.ekf.kernels.deferred_downdate import postpone
from slamgauge.ekf.kernels.joint_update import take_in
from slamgauge.ekf.kernels.workspace import CORRECTION, HEADING_ROW, MOVE, Workspace
from slamgauge.jit import kernel
from slamgauge.se2_kernels import mean_rotation, wrap


@kernel
def update_standard(sensor: int, belief: Belief, count: int, work: Workspace) -> tuple[float, int]:
    """Correct: x <- x + dx, P <- P - W'W, with Jacobians as the belief wants them.

    Returns the NIS and its degrees of freedom; when the NIS is not finite, nothing has changed.
    """
    nis, informative = take_in(sensor, belief, count, work)
    if math.isfinite(nis):
        retract_standard(belief, work)
    return nis, informative


@kernel
def retract_standard(belief: Belief, work: Workspace) -> None:
    """Move by the correction dx in the workspace: x <- x + dx."""
    move_additively(belief.state, belief.size, work.scratch[CORRECTION])


@kernel
def move_additively(state: Float, size: int, dx: Float) -> None:
    """Move everything by dx."""
    for i in range(size):
        state[i] += dx[i]
    state[2] = wrap(state[2])


@kernel
def update_right_invariant(sensor: int, belief: Belief, count: int, work: Workspace) -> tuple[float, int]:
    """Correct: x <- exp(D^-1 dx) x, P <- T (P - W'W) T'; returns as `update_standard`."""
    nis, informative = take_in(sensor, belief, count, work)
    if math.isfinite(nis):
        retract_right_invariant(belief, work)
    return nis, informative


@kernel
def retract_right_invariant(belief: Belief, work: Workspace) -> None:
    """Move by the correction dx in the workspace: x <- exp(D^-1 dx) x, P <- T P T'."""
    move_invariantly(belief, work.scratch[CORRECTION], work.scratch[MOVE])
    carry_covariance(belief, work.scratch[MOVE], work)


@kernel
def move_invariantly(belief: Belief, dx: Float, u: Float) -> None:
    """Move every point by V(dtheta) dx, all else by dx, and leave u of T = I + u e_theta'."""
    state, turn = belief.state, dx[2]
    v_cos, v_sin = mean_rotation(turn)
    _move(state, dx, u, 0, v_cos, v_sin)
    state[2] = wrap(state[2] + turn)
    u[2] = 0.0
    for i in range(3, belief.size, 2):
        if belief.points[(i - 3) // 2]:
            _move(state, dx, u, i, v_cos, v_sin)
        else:
            for k in (i, i + 1):
                state[k] += dx[k]
                u[k] = 0.0


@kernel
def carry_covariance(belief: Belief, u: Float, work: Workspace) -> None:
    """P <- T P T' = P + u a' + a u' with a = P e_theta + u P_theta,theta / 2, for T = I + u e_theta'.

    Where something waits, this waits behind it.
    """
    cov, size, heading_row = belief.cov, belief.size, work.scratch[HEADING_ROW]
    heading_row[0], heading_row[1] = cov[0, 2], cov[1, 2]
    for j in range(2, size):
        heading_row[j] = cov[2, j]
    half = 0.5 * cov[2, 2]
    for j in range(size):
        heading_row[j] += half * u[j]
    if work.waiting.used[0] > 0:
        pair = np.stack((u, heading_row))
        postpone(cov, size, work.waiting, pair, -pair[::-1])
    else:
        add_outer_pair(cov, u, heading_row, size)
        mirror_robot_block(cov)


@kernel
def _move(state: Float, dx: Float, u: Float, i: int, v_cos: float, v_sin: float) -> None:
    """Move the point at entry i by V dx, and note J times that move in u."""
    move_x = v_cos * dx[i] - v_sin * dx[i + 1]
    move_y = v_sin * dx[i] + v_cos * dx[i + 1]
    state[i] += move_x
    state[i + 1] += move_y
    u[i] = -move_y
    u[i + 1] = move_x
