"""The practical's nearest neighbour: observation by observation, associate, correct or map, then the next.

Every observation changes the state at once, but the covariance of the whole map only at the end of a block.
Until then P = P0 - W'W is kept as P0 and the rows of W, two for each observation taken in, and only those
entries of P are formed that the next observation needs. That is exact.

For the right-invariant filter P = T (P0 - W'W) T' with T = I + u e_theta', u = J (state - anchor), where the
anchor is the state at P0. All its rows W are kept in the anchor's coordinates, where H becomes H T: the heading's
column alone differs. A new landmark is anchored where it is put.
"""

from __future__ import annotations

import math

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.augmentation import append_landmark
from slamgauge.ekf.kernels.compatibility import NONE
from slamgauge.ekf.kernels.compiled import kernel, subtract_gram
from slamgauge.ekf.kernels.corrections import SETTLED, carry_covariance, move_invariantly
from slamgauge.ekf.kernels.covariance import mirror_robot_block, project_covariance, projected, squared_distance
from slamgauge.ekf.kernels.linearisation import linearise
from slamgauge.ekf.kernels.models import POSITION, wrap
from slamgauge.ekf.kernels.take_in import are_sound
from slamgauge.ekf.kernels.workspace import Workspace

NEW = -2  # the landmark of an observation that is to be mapped


@kernel
def update_one_by_one(
    sensor: int,
    state: Float,
    point: Float,
    cov: Float,
    size: int,
    count: int,
    gate: float,
    new_gate: float,
    invariant: bool,
    passes: int,
    work: Workspace,
) -> tuple[float, int, int]:
    """Associate, correct and map with the first `count` observations of `work`, one after the other.

    The landmark of each goes to `work.slots`, NONE where it has none: an observation farther than `gate` from
    every landmark, but within `new_gate` of one that this scan has not seen, may be that one's outlier.

    Args:
        sensor: see `models`.
        state: and point, cov, size, as in `kernels`; with room for `count` more landmarks.
        point: see `state`.
        cov: see `state`.
        size: see `state`.
        count: how many observations.
        gate: largest squared Mahalanobis distance of an association.
        new_gate: no less than `gate`.
        invariant: whether the filter is the right-invariant one.
        passes: linearisations of an observation at most; more than one for the iterated filter.
        work: its `slots` are the result.

    Returns:
        NIS, its degrees of freedom and the new size; a NIS that is not finite says that there is no update.
    """
    slots, anchor = work.slots, work.scratch[1]
    if not are_sound(work.observation[:count], work.observation_cov[:count]):
        return math.nan, 0, size
    if invariant:
        anchor[:size] = state[:size]
    reference = anchor if invariant else point
    one, g = np.zeros(1, dtype=np.int64), np.zeros((2, len(work.W)))
    nis, informative, rows = 0.0, 0, 0
    for i in range(count):
        if rows + 2 > len(work.W):
            _settle(state, cov, size, rows, invariant, work)
            anchor[:size] = state[:size]
            rows = 0
        slots[i] = _nearest(sensor, state, point, cov, size, rows, i, gate, new_gate, invariant, anchor, work, one, g)
        if slots[i] == NEW:
            _append(sensor, state, reference, cov, size, rows, i, work)
            slots[i] = (size - 3) // 2
            size += 2
        elif slots[i] != NONE:
            one[0] = slots[i]
            added, dof = _take_in(sensor, state, point, cov, size, rows, i, invariant, passes, anchor, work, one, g)
            if not math.isfinite(added):
                return math.nan, informative, size
            nis, informative, rows = nis + added, informative + dof, rows + 2
    _settle(state, cov, size, rows, invariant, work)
    return nis, informative, size


@kernel
def _settle(state: Float, cov: Float, size: int, rows: int, invariant: bool, work: Workspace) -> None:
    """P <- T (P0 - W'W) T'."""
    if rows == 0:
        return
    subtract_gram(cov, work.W, rows, size)
    mirror_robot_block(cov)
    if invariant:
        u = work.scratch[0]
        _fill_turn(state, work.scratch[1], size, u)
        carry_covariance(cov, size, u, work.scratch[2])


@kernel
def _fill_turn(state: Float, anchor: Float, size: int, u: Float) -> None:
    """U = J (state - anchor) of every point."""
    u[0], u[1], u[2] = anchor[1] - state[1], state[0] - anchor[0], 0.0
    for j in range(3, size, 2):
        u[j], u[j + 1] = anchor[j + 1] - state[j + 1], state[j] - anchor[j]


@kernel
def _describe(
    sensor: int,
    state: Float,
    point: Float,
    cov: Float,
    rows: int,
    i: int,
    invariant: bool,
    anchor: Float,
    work: Workspace,
    one: Int,
    g: Float,
) -> tuple[int, float, float, float]:
    """Innovation, Jacobian and g = H W' of observation i for the landmark one[0]; its S, and the informative rows."""
    v, h = work.innovation[2 * i : 2 * i + 2], work.jacobian[2 * i : 2 * i + 2]
    informative = linearise(sensor, state, point, one, work.observation[i : i + 1], v, h)
    landmark = 3 + 2 * one[0]
    if invariant:
        for k in range(2):
            h[k, 2] += h[k, 0] * (anchor[1] - state[1]) + h[k, 1] * (state[0] - anchor[0])
            h[k, 2] += h[k, 3] * (anchor[landmark + 1] - state[landmark + 1])
            h[k, 2] += h[k, 4] * (state[landmark] - anchor[landmark])
    s00, s01, s11 = projected(cov, h, landmark)
    for k in range(rows):
        w = work.W[k]
        for a in range(2):
            g[a, k] = h[a, 0] * w[0] + h[a, 1] * w[1] + h[a, 2] * w[2]
            g[a, k] += h[a, 3] * w[landmark] + h[a, 4] * w[landmark + 1]
        s00 -= g[0, k] * g[0, k]
        s01 -= g[0, k] * g[1, k]
        s11 -= g[1, k] * g[1, k]
    R = work.observation_cov[i]
    if h[1, 3] != 0.0 or h[1, 4] != 0.0:  # else the bearing was skipped
        s01 += R[0, 1]
    return informative, s00 + R[0, 0], s01, s11 + R[1, 1]


@kernel
def _nearest(
    sensor: int,
    state: Float,
    point: Float,
    cov: Float,
    size: int,
    rows: int,
    i: int,
    gate: float,
    new_gate: float,
    invariant: bool,
    anchor: Float,
    work: Workspace,
    one: Int,
    g: Float,
) -> int:
    """Slot of the landmark nearest to observation i if it is within `gate`, else NEW, or NONE for an outlier.

    Far landmarks are set aside as in `compatibility`; the variances of P0 and the way from the anchor bound those of P.
    """
    z, R = work.observation[i], work.observation_cov[i]
    measured, noise = z[0], R[0, 0]
    if sensor == POSITION:
        measured, noise = math.sqrt(z[0] ** 2 + z[1] ** 2), R[0, 0] + R[1, 1]
    robot, heading = math.sqrt(max(cov[0, 0] + cov[1, 1], 0.0)), math.sqrt(max(cov[2, 2], 0.0))
    moved = math.hypot(state[0] - anchor[0], state[1] - anchor[1]) if invariant else 0.0
    slot, least, doubtful = NONE, math.inf, False
    for landmark in range(3, size, 2):
        expected = math.sqrt((state[landmark] - state[0]) ** 2 + (state[landmark + 1] - state[1]) ** 2)
        own = math.sqrt(max(cov[landmark, landmark] + cov[landmark + 1, landmark + 1], 0.0))
        lever = moved
        if invariant:
            lever += math.hypot(state[landmark] - anchor[landmark], state[landmark + 1] - anchor[landmark + 1])
        if sensor == POSITION:
            lever += math.hypot(point[landmark] - point[0], point[landmark + 1] - point[1])
        spread = robot + own + lever * heading
        if (measured - expected) ** 2 > new_gate * (spread * spread + noise):
            continue
        one[0] = (landmark - 3) // 2
        _, s00, s01, s11 = _describe(sensor, state, point, cov, rows, i, invariant, anchor, work, one, g)
        v0, v1 = work.innovation[2 * i], work.innovation[2 * i + 1]
        distance = squared_distance(v0, v1, s00, s01, s11)
        if not distance <= new_gate:
            continue
        if distance < least:
            slot, least = one[0], distance
        doubtful = doubtful or not _is_seen(work.slots, i, one[0])
    if least <= gate:
        return slot
    return NONE if doubtful else NEW


@kernel
def _is_seen(slots: Int, i: int, slot: int) -> bool:
    """Whether one of the first i observations was of the landmark in `slot`."""
    for k in range(i):  # noqa: SIM110 numba compiles no generator expressions
        if slots[k] == slot:
            return True
    return False


@kernel
def _append(
    sensor: int, state: Float, reference: Float, cov: Float, size: int, rows: int, i: int, work: Workspace
) -> None:
    """Map a landmark at observation i: its rows of P0 and its columns of W."""
    append_landmark(sensor, state, reference, cov, size, work.observation[i], work.observation_cov[i])
    lever_x, lever_y = state[size] - reference[0], state[size + 1] - reference[1]
    for k in range(rows):
        w = work.W[k]
        w[size] = w[0] - lever_y * w[2]
        w[size + 1] = w[1] + lever_x * w[2]


@kernel
def _take_in(
    sensor: int,
    state: Float,
    point: Float,
    cov: Float,
    size: int,
    rows: int,
    i: int,
    invariant: bool,
    passes: int,
    anchor: Float,
    work: Workspace,
    one: Int,
    g: Float,
) -> tuple[float, int]:
    """Correct the state with observation i of the landmark one[0]; two more rows of W. Returns NIS and its dof."""
    W = work.W[rows : rows + 2]
    dx, at = work.scratch[0], work.scratch[2]
    v, h = work.innovation[2 * i : 2 * i + 2], work.jacobian[2 * i : 2 * i + 2]
    place = state
    if passes > 1:
        place = at
        at[:size] = state[:size]
    nis, informative, landmark = math.nan, 0, 3 + 2 * one[0]
    for k in range(passes):
        linearised = place if passes > 1 else point
        dof, s00, s01, s11 = _describe(sensor, place, linearised, cov, rows, i, invariant, anchor, work, one, g)
        if passes > 1:  # v - H (state - at)
            for a in range(2):
                for b in range(3):
                    v[a] -= h[a, b] * (state[b] - at[b])
                for b in range(2):
                    v[a] -= h[a, 3 + b] * (state[landmark + b] - at[landmark + b])
        if not (s00 > 0.0 and s00 * s11 - s01 * s01 > 0.0):
            return math.nan, dof
        project_covariance(cov, size, one, h, W)
        u00 = math.sqrt(s00)
        u01 = s01 / u00
        u11 = math.sqrt(s11 - u01 * u01)
        y0 = v[0] / u00
        y1 = (v[1] - u01 * y0) / u11
        for r in range(rows):
            g0, g1, w = g[0, r], g[1, r], work.W[r]
            for j in range(size):
                W[0, j] -= g0 * w[j]
                W[1, j] -= g1 * w[j]
        for j in range(size):
            W[0, j] /= u00
            W[1, j] = (W[1, j] - u01 * W[0, j]) / u11
            dx[j] = W[0, j] * y0 + W[1, j] * y1
        if k == 0:
            nis, informative = y0 * y0 + y1 * y1, dof
        if passes > 1:
            change = 0.0
            for j in range(size):
                change = max(change, abs(state[j] + dx[j] - at[j]))
                at[j] = state[j] + dx[j]
            if change < SETTLED:
                break
    if not math.isfinite(nis):
        return math.nan, informative
    if invariant:
        u = work.scratch[2]
        _fill_turn(state, anchor, size, u)
        for j in range(size):
            dx[j] += u[j] * dx[2]
        move_invariantly(state, size, work.points, dx, u)
    else:
        for j in range(size):
            state[j] += dx[j]
        state[2] = wrap(state[2])
    return nis, informative
