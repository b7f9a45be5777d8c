"""The corrections of the filters: how the innovations of a step change the state and its covariance.

All corrections start from the additive correction of `kernels.joint_update`: dx = W'y and P <- P - W'W.

The first-estimates filter is the standard filter with Jacobians at another `point`: the first estimate of each landmark
and the predicted pose. Rotation and translation of the whole map then stay unobservable, because H F...F N = 0 for
N = [I, J p; 0, 1; I, J l]. Poor first estimates give poor Jacobians.

The observability-constrained filter predicts with the same F and therefore has the same N. It evaluates H at the newest
estimate and replaces it by the nearest matrix (Frobenius norm) with H N = 0 (`linearisation.project_on_observable`).

The iterated filter evaluates its Jacobians at the minimum of the cost of the step: see `kernels.iterated_update`.

The right-invariant filter uses the same coordinates as the others. Its error xi is defined by
theta = theta^ + xi_theta and p = R(xi_theta) p^ + V(xi_theta) xi_p (the same for landmarks). To first order it is
xi = D^-1 (additive error), D = [I, J p; 0, 1] with landmark rows [I, J l]. Therefore

* prediction, Jacobians and augmentation are those of the standard filter, transformed by D: D F D^-1 and so on;
* because V(t) t J = R(t) - I, the retraction exp(xi) moves every point by V(dtheta) dx;
* D changes with the estimate, so the covariance is transformed after the correction:
  P <- T P T' with T = D(after) D(before)^-1 = I + u e_theta', u = J (after - before) for positions.

The last step is a symmetric rank-2 change. It keeps translation and rotation of the whole map unobservable; the
standard filter does not transform P.

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
from slamgauge.ekf.kernels.deferred_downdate import Deferred, defer
from slamgauge.ekf.kernels.joint_update import joint_update
from slamgauge.ekf.kernels.workspace import Workspace
from slamgauge.jit import inner, kernel
from slamgauge.se2_kernels import mean_rotation, wrap


@kernel
def update_standard(sensor: int, belief: Belief, count: int, work: Workspace) -> tuple[float, int]:
    """Correct with the first `count` observations of `work`: x <- x + dx, P <- P - W'W.

    Returns the NIS and its degrees of freedom. If the NIS is not finite, the belief is unchanged.
    """
    update = joint_update(sensor, belief, count, work)
    if math.isfinite(update.nis):
        retract_standard(belief, update.dx, work.deferred)
    return update.nis, update.dof


@kernel
def update_right_invariant(sensor: int, belief: Belief, count: int, work: Workspace) -> tuple[float, int]:
    """Correct: x <- exp(D^-1 dx) x, P <- T (P - W'W) T'; return the same as `update_standard`."""
    update = joint_update(sensor, belief, count, work)
    if math.isfinite(update.nis):
        retract_right_invariant(belief, update.dx, work.deferred)
    return update.nis, update.dof


@kernel
def retract_standard(belief: Belief, dx: Float, deferred: Deferred) -> None:  # noqa: ARG001 a retraction of `Rule`
    """Move the state: x <- x + dx."""
    move_additively(belief.state, belief.size, dx)


@kernel
def retract_right_invariant(belief: Belief, dx: Float, deferred: Deferred) -> None:
    """Move the state and transform the covariance: x <- exp(D^-1 dx) x, P <- T P T'."""
    u = move_invariantly(belief, dx)
    transform_covariance(belief, u, deferred)


@inner
def move_additively(state: Float, size: int, dx: Float) -> None:
    """Add dx to all entries."""
    for i in range(size):
        state[i] += dx[i]
    state[2] = wrap(state[2])


@inner
def move_invariantly(belief: Belief, dx: Float) -> Float:
    """Move every point by V(dtheta) dx and all other entries by dx; return u (size,) of T = I + u e_theta'."""
    state, turn, u = belief.state, dx[2], np.empty(belief.size)
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
    return u


@inner
def transform_covariance(belief: Belief, u: Float, deferred: Deferred) -> None:
    """P <- T P T' = P + u a' + a u' with a = P e_theta + u P_theta,theta / 2, for T = I + u e_theta'.

    If rows are deferred already, this change is deferred after them.
    """
    cov, size, a = belief.cov, belief.size, np.empty(belief.size)
    a[0], a[1] = cov[0, 2], cov[1, 2]
    for j in range(2, size):
        a[j] = cov[2, j]
    half = 0.5 * cov[2, 2]
    for j in range(size):
        a[j] += half * u[j]
    if deferred.used[0] > 0:
        L, R = np.empty((2, size)), np.empty((2, size))
        for j in range(size):
            L[0, j], L[1, j] = u[j], a[j]
            R[0, j], R[1, j] = -a[j], -u[j]
        defer(cov, size, deferred, L, R)
    else:
        add_outer_pair(cov, u, a, size)
        mirror_robot_block(cov)


@inner
def _move(state: Float, dx: Float, u: Float, i: int, v_cos: float, v_sin: float) -> None:
    """Move the point at entry i by V dx, and set its entries of u to J V dx."""
    move_x = v_cos * dx[i] - v_sin * dx[i + 1]
    move_y = v_sin * dx[i] + v_cos * dx[i + 1]
    state[i] += move_x
    state[i + 1] += move_y
    u[i] = -move_y
    u[i + 1] = move_x
