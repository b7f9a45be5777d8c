"""The practical's nearest neighbour: observation by observation, associate, correct or map, then the next.

Every observation changes the state at once, but the covariance of the whole map only at the end of a block.
Until then P = P0 - W'W is kept as P0 and the rows of W, two for each observation taken in, and only those
entries of P are formed that the next observation needs. That is exact.

For the right-invariant filter P = T (P0 - W'W) T' with T = I + u e_theta', u = J (state - anchor), where the
anchor is the state at P0. All rows of W are kept in the coordinates of the anchor, where H becomes H T: only its
column of the heading differs. A new landmark is anchored where it is put.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels.augmentation import append_landmark
from slamgauge.ekf.kernels.belief import Belief, at_place, resized
from slamgauge.ekf.kernels.blas import subtract_gram
from slamgauge.ekf.kernels.corrections import carry_covariance, move_additively, move_invariantly
from slamgauge.ekf.kernels.covariance import (
    mirror_robot_block,
    noise,
    project_covariance,
    projected,
    squared_distance,
)
from slamgauge.ekf.kernels.individual_compatibility import NONE, Reach, is_within_reach, reach_of
from slamgauge.ekf.kernels.iterated_minimum import Seen, find_minimum, silence
from slamgauge.ekf.kernels.iterated_update import block, involved_entries
from slamgauge.ekf.kernels.joint_update import are_sound
from slamgauge.ekf.kernels.linearisation import linearise
from slamgauge.ekf.kernels.rounding_limits import EXHAUSTED, LEAST, NO_MINIMUM, are_variances_lost
from slamgauge.ekf.kernels.student_t_weights import inflation
from slamgauge.ekf.kernels.workspace import (
    ANCHOR,
    CORRECTION,
    MOVE_FROM_ANCHOR,
    MOVE_OF_ONE,
    PLACE_OF_ONE,
    Workspace,
)
from slamgauge.jit import kernel
from slamgauge.sensor_kernels import HAS_RANGE

ROBOT_ALONE = np.zeros(0, dtype=np.int64)
NEW = -2  # the landmark of an observation that is to be mapped


class Sequential(NamedTuple):
    """How a filter corrects with one observation after the other."""

    invariant: bool = False  # whether it is the right-invariant filter
    passes: int = 1  # linearisations of an observation at most; more than one for the iterated filter


class Gates(NamedTuple):
    """Squared Mahalanobis distances of an observation and a landmark, and how far an observation is trusted."""

    same: float  # largest of an association
    new: float  # no less; an observation within this of a landmark that the scan has not seen maps no other
    tails: float = math.inf  # degrees of freedom of the observations' noise (see `weighing`)


class Scan(NamedTuple):
    """A scan that is being taken in, observation by observation."""

    sensor: int
    form: Sequential
    work: Workspace  # its row ANCHOR is the state at P0
    rows: int  # of W, filled by the observations before this one
    row: int  # this observation
    one: Int  # (1,) slot of the landmark that this observation is compared with
    g: Float  # (2, rows) H W' of this observation
    blind: Marks  # (1,) whether its bearing has lost its information on the way to a minimum


@kernel
def update_one_by_one(
    sensor: int, belief: Belief, count: int, gates: Gates, form: Sequential, work: Workspace
) -> tuple[float, int, int]:
    """Associate, correct and map with the first `count` observations of `work`, one after the other.

    The landmark of each goes to `work.slots`, NONE where it has none: an observation farther than `gates.same` from
    every landmark, but within `gates.new` of one that this scan has not seen, may be an outlier of that landmark.

    Args:
        sensor: see `models`.
        belief: with room for `count` more landmarks.
        count: how many observations.
        gates: see `Gates`.
        form: see `Sequential`.
        work: its `slots` are the result.

    Returns:
        NIS, its degrees of freedom and the new size; a NIS that is not finite says that there is no update.
    """
    if not are_sound(sensor, work.observation[:count], work.observation_cov[:count]):
        return math.nan, 0, belief.size
    if form.invariant:
        work.scratch[ANCHOR, : belief.size] = belief.state[: belief.size]
    one, g, blind = np.zeros(1, dtype=np.int64), np.zeros((2, len(work.W))), np.zeros(1, dtype=np.bool_)
    nis, informative, rows = 0.0, 0, 0
    for i in range(count):
        if rows + 2 > len(work.W):
            if not _settle(belief, rows, form, work):
                return EXHAUSTED, informative, belief.size
            work.scratch[ANCHOR, : belief.size] = belief.state[: belief.size]
            rows = 0
        blind[0] = False
        scan = Scan(sensor, form, work, rows, i, one, g, blind)
        slot = _nearest(scan, belief, gates)
        if slot == NEW:
            _append(scan, belief)
            slot = (belief.size - 3) // 2
            belief = resized(belief, belief.size + 2)
        elif slot != NONE:
            one[0] = slot
            if gates.tails < math.inf:
                _, s00, s01, s11 = _describe(scan, belief)
                distance = squared_distance(work.innovation[2 * i], work.innovation[2 * i + 1], s00, s01, s11)
                work.observation_cov[i] *= inflation(sensor, distance, gates.tails)
            added, dof = _take_in(scan, belief)
            if not math.isfinite(added):
                return added, informative, belief.size
            nis, informative, rows = nis + added, informative + dof, rows + 2
        work.slots[i] = slot
    if not _settle(belief, rows, form, work):
        return EXHAUSTED, informative, belief.size
    return nis, informative, belief.size


@kernel
def _settle(belief: Belief, rows: int, form: Sequential, work: Workspace) -> bool:
    """P <- T (P0 - W'W) T'; False, with nothing changed, when nothing but rounding is left of a variance."""
    if rows == 0:
        return True
    if are_variances_lost(belief.cov, ROBOT_ALONE, work.W, rows):
        return False
    subtract_gram(belief.cov, work.W, rows, belief.size)
    mirror_robot_block(belief.cov)
    if form.invariant:
        u = work.scratch[MOVE_FROM_ANCHOR]
        _fill_move(belief, work.scratch[ANCHOR], u)
        carry_covariance(belief, u, work)
    return True


@kernel
def _fill_move(belief: Belief, anchor: Float, u: Float) -> None:
    """Fill u = J (state - anchor) of every point."""
    state = belief.state
    u[0], u[1], u[2] = anchor[1] - state[1], state[0] - anchor[0], 0.0
    for j in range(3, belief.size, 2):
        u[j], u[j + 1] = anchor[j + 1] - state[j + 1], state[j] - anchor[j]


@kernel
def _describe(scan: Scan, belief: Belief) -> tuple[int, float, float, float]:
    """Innovation, Jacobian and g = H W' of the observation for its landmark; informative rows, and its S."""
    work, i = scan.work, scan.row
    v, h = work.innovation[2 * i : 2 * i + 2], work.jacobian[2 * i : 2 * i + 2]
    informative = linearise(scan.sensor, belief, scan.one, work.observation[i : i + 1], v, h)
    silence(scan.blind, v, h)
    landmark = 3 + 2 * scan.one[0]
    if scan.form.invariant:
        _turn_to_anchor(belief.state, work.scratch[ANCHOR], landmark, h)
    s00, s01, s11 = projected(belief.cov, h, landmark)
    g = scan.g
    for k in range(scan.rows):
        w = work.W[k]
        for a in range(2):
            g[a, k] = h[a, 0] * w[0] + h[a, 1] * w[1] + h[a, 2] * w[2]
            g[a, k] += h[a, 3] * w[landmark] + h[a, 4] * w[landmark + 1]
        s00 -= g[0, k] * g[0, k]
        s01 -= g[0, k] * g[1, k]
        s11 -= g[1, k] * g[1, k]
    r00, r01, r11 = noise(work.observation_cov[i], h[1])
    return informative, s00 + r00, s01 + r01, s11 + r11


@kernel
def _turn_to_anchor(state: Float, anchor: Float, landmark: int, h: Float) -> None:
    """H <- H T, in the coordinates of the anchor."""
    for k in range(2):
        h[k, 2] += h[k, 0] * (anchor[1] - state[1]) + h[k, 1] * (state[0] - anchor[0])
        h[k, 2] += h[k, 3] * (anchor[landmark + 1] - state[landmark + 1])
        h[k, 2] += h[k, 4] * (state[landmark] - anchor[landmark])


@kernel
def _nearest(scan: Scan, belief: Belief, gates: Gates) -> int:
    """Slot of the landmark nearest to the observation if it is within the gate, else NEW, or NONE for an outlier."""
    work, i, one = scan.work, scan.row, scan.one
    reach = reach_of(scan.sensor, work.observation[i], work.observation_cov[i], belief.cov)
    if scan.form.invariant:  # P is seen from the anchor, and turns with the heading there
        heading = math.sqrt(max(belief.cov[2, 2], 0.0))
        reach = Reach(reach.measured, reach.noise, reach.robot, heading)
    slot, least, doubtful = NONE, math.inf, False
    for landmark in range(3, belief.size, 2):
        if not is_within_reach(reach, belief, landmark, _lever(scan, belief, landmark), gates.new):
            continue
        one[0] = (landmark - 3) // 2
        _, s00, s01, s11 = _describe(scan, belief)
        distance = squared_distance(work.innovation[2 * i], work.innovation[2 * i + 1], s00, s01, s11)
        if not distance <= gates.new:
            continue
        if distance < least:
            slot, least = one[0], distance
        doubtful = doubtful or not _is_seen(work.slots, i, one[0])
    if least <= gates.same:
        return slot
    return NONE if doubtful else NEW


@kernel
def _lever(scan: Scan, belief: Belief, landmark: int) -> float:
    """How far the heading of P0 moves what is measured, at most [m/rad]."""
    lever = 0.0
    if scan.form.invariant:
        state, anchor = belief.state, scan.work.scratch[ANCHOR]
        lever += math.hypot(state[0] - anchor[0], state[1] - anchor[1])
        lever += math.hypot(state[landmark] - anchor[landmark], state[landmark + 1] - anchor[landmark + 1])
    if not HAS_RANGE[scan.sensor]:
        point = belief.point
        lever += math.hypot(point[landmark] - point[0], point[landmark + 1] - point[1])
    return lever


@kernel
def _is_seen(slots: Int, i: int, slot: int) -> bool:
    """Whether one of the first i observations was of the landmark in `slot`."""
    for k in range(i):  # noqa: SIM110 numba compiles no generator expressions
        if slots[k] == slot:
            return True
    return False


@kernel
def _append(scan: Scan, belief: Belief) -> None:
    """Map a landmark at the observation: its rows of P0 and its columns of W."""
    work, state, x, y = scan.work, belief.state, belief.size, belief.size + 1
    reference = work.scratch[ANCHOR] if scan.form.invariant else belief.point
    append_landmark(scan.sensor, belief, reference, work.observation[scan.row], work.observation_cov[scan.row])
    lever_x, lever_y = state[x] - reference[0], state[y] - reference[1]
    for k in range(scan.rows):
        w = work.W[k]
        w[x] = w[0] - lever_y * w[2]
        w[y] = w[1] + lever_x * w[2]


@kernel
def _take_in(scan: Scan, belief: Belief) -> tuple[float, int]:
    """Correct the state with the observation of its landmark; two more rows of W. Returns NIS and its dof."""
    work, size, state = scan.work, belief.size, belief.state
    dx = work.scratch[CORRECTION]
    if scan.form.passes > 1:
        return _iterate(scan, belief)
    nis, informative = _gain(scan, belief, belief)
    if not math.isfinite(nis):
        return nis, informative
    if scan.form.invariant:
        u = work.scratch[MOVE_OF_ONE]
        _fill_move(belief, work.scratch[ANCHOR], u)
        for j in range(size):
            dx[j] += u[j] * dx[2]
        move_invariantly(belief, dx, u)
    else:
        move_additively(state, size, dx)
    return nis, informative


@kernel
def _iterate(scan: Scan, belief: Belief) -> tuple[float, int]:
    """Correct the state to a minimum of the cost of prior and observation (see `iterated`); returns as `_take_in`."""
    work, i, state = scan.work, scan.row, belief.state
    nis, informative = _gain(scan, belief, at_place(belief, state))
    if not math.isfinite(nis):
        return nis, informative
    entries, local = involved_entries(scan.one)
    P, there = block(belief.cov, entries), state[entries]
    for k in range(scan.rows):
        w = work.W[k]
        for a in range(len(entries)):
            for b in range(len(entries)):
                P[a, b] -= w[entries[a]] * w[entries[b]]
    seen = Seen(scan.sensor, local, work.observation[i : i + 1], work.observation_cov[i : i + 1], scan.blind)
    if not find_minimum(there, P, seen, scan.form.passes):
        return NO_MINIMUM, informative
    place = work.scratch[PLACE_OF_ONE]
    for a in range(len(entries)):
        place[entries[a]] = there[a]
    last, _ = _gain(scan, belief, at_place(belief, place))
    if not math.isfinite(last):
        return last, informative
    move_additively(state, belief.size, work.scratch[CORRECTION])
    return nis, informative


@kernel
def _gain(scan: Scan, belief: Belief, there: Belief) -> tuple[float, int]:
    """Two more rows of W, and the correction dx, by Jacobians of the belief `there`; returns NIS and its dof."""
    work, i, size, landmark = scan.work, scan.row, belief.size, 3 + 2 * scan.one[0]
    W, dx = work.W[scan.rows : scan.rows + 2], work.scratch[CORRECTION]
    v, h = work.innovation[2 * i : 2 * i + 2], work.jacobian[2 * i : 2 * i + 2]
    dof, s00, s01, s11 = _describe(scan, there)
    if scan.form.passes > 1:
        _refer_to_prior(belief.state, there.state, landmark, h, v)
    if not (s00 > 0.0 and s00 * s11 - s01 * s01 > 0.0):
        return math.nan, dof
    project_covariance(belief.cov, size, scan.one, h, W)
    u00 = math.sqrt(s00)
    u01 = s01 / u00
    left = s11 - u01 * u01
    if left <= LEAST * s11:
        return EXHAUSTED, dof
    u11 = math.sqrt(left)
    y0 = v[0] / u00
    y1 = (v[1] - u01 * y0) / u11
    for r in range(scan.rows):
        g0, g1, w = scan.g[0, r], scan.g[1, r], work.W[r]
        for j in range(size):
            W[0, j] -= g0 * w[j]
            W[1, j] -= g1 * w[j]
    for j in range(size):
        W[0, j] /= u00
        W[1, j] = (W[1, j] - u01 * W[0, j]) / u11
        dx[j] = W[0, j] * y0 + W[1, j] * y1
    return y0 * y0 + y1 * y1, dof


@kernel
def _refer_to_prior(state: Float, place: Float, landmark: int, h: Float, v: Float) -> None:
    """Subtract H (state - place) from the innovation v, which was taken at `place`."""
    for k in range(2):
        for j in range(3):
            v[k] -= h[k, j] * (state[j] - place[j])
        for j in range(2):
            v[k] -= h[k, 3 + j] * (state[landmark + j] - place[landmark + j])
