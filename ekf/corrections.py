"""What tells the filters apart: how a step's innovations correct the state and its covariance.

Both start from the same additive quantities that `kernels.whiten` leaves: the gain's factor W and the
whitened innovation y, with dx = W'y and P <- P - W'W.

The right-invariant filter needs no other coordinates than these. Its error xi, with
theta = theta^ + xi_theta and p = R(xi_theta) p^ + V(xi_theta) xi_p (landmarks likewise), is
xi = D^-1 (additive error), D = [I, J p; 0, 1] with landmark rows [I, J l]. Written out:

* prediction, Jacobians and new landmarks are those of the standard filter, D F D^-1 and so on;
* because V(t) t J = R(t) - I, the retraction exp(xi) moves every point by V(dtheta) dx alone;
* D changes with the estimate, so after the correction the covariance is carried along:
  P <- T P T' with T = D(after) D(before)^-1 = I + u e_theta', u = J (after - before) for positions.

That last step is a symmetric rank-2 change. It is what keeps the unobservable directions (shift and
turn of the whole map) unobservable: the standard filter leaves P at the old estimate.

Source: Barrau and Bonnabel, arXiv 1510.06263 (2015); Zhang et al., RA-L 2017.
"""

from __future__ import annotations

import math

from ekf.compiled import add_outer_pair, combine_rows, kernel, subtract_gram
from ekf.kernels import Workspace, mirror_robot_block, whiten
from ekf.models import wrap
from slam2d import Float


@kernel
def update_standard(sensor: int, state: Float, cov: Float, size: int, count: int, work: Workspace) -> tuple[float, int]:
    """Correct: x <- x + dx, P <- P - W'W; returns as `whiten`, changing nothing when the NIS is not finite."""
    nis, informative = whiten(sensor, state, cov, size, count, work)
    if not math.isfinite(nis):
        return nis, informative
    dx = work.scratch[0]
    combine_rows(work.W, work.innovation, dx, 2 * count, size)
    for i in range(size):
        state[i] += dx[i]
    state[2] = wrap(state[2])
    subtract_gram(cov, work.W, 2 * count, size)
    mirror_robot_block(cov)
    return nis, informative


@kernel
def update_right_invariant(
    sensor: int, state: Float, cov: Float, size: int, count: int, work: Workspace
) -> tuple[float, int]:
    """Correct: x <- exp(D^-1 dx) x, P <- T (P - W'W) T'; returns as `update_standard`."""
    nis, informative = whiten(sensor, state, cov, size, count, work)
    if not math.isfinite(nis):
        return nis, informative
    dx, u, heading_row = work.scratch[0], work.scratch[1], work.scratch[2]
    combine_rows(work.W, work.innovation, dx, 2 * count, size)
    subtract_gram(cov, work.W, 2 * count, size)
    turn = dx[2]
    v_cos = math.sin(turn) / turn if turn != 0.0 else 1.0
    v_sin = 2.0 * math.sin(turn / 2.0) ** 2 / turn if turn != 0.0 else 0.0
    _move(state, dx, u, 0, v_cos, v_sin)
    state[2] = wrap(state[2] + turn)
    u[2] = 0.0
    for i in range(3, size, 2):
        _move(state, dx, u, i, v_cos, v_sin)
    # T P T' = P + u a' + a u' with a = P e_theta + u P_theta,theta / 2
    heading_row[0], heading_row[1] = cov[0, 2], cov[1, 2]
    for j in range(2, size):
        heading_row[j] = cov[2, j]
    half = 0.5 * cov[2, 2]
    for j in range(size):
        heading_row[j] += half * u[j]
    add_outer_pair(cov, u, heading_row, size)
    mirror_robot_block(cov)
    return nis, informative


@kernel
def _move(state: Float, dx: Float, u: Float, i: int, v_cos: float, v_sin: float) -> None:
    """Move the point at entry i by V dx, and note J times that move in u."""
    move_x = v_cos * dx[i] - v_sin * dx[i + 1]
    move_y = v_sin * dx[i] + v_cos * dx[i + 1]
    state[i] += move_x
    state[i + 1] += move_y
    u[i] = -move_y
    u[i + 1] = move_x
