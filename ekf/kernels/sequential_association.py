"""Nearest-neighbour association as in the exercise: for each observation, associate, then correct or map; compiled.

Every observation changes the state immediately, but the covariance of the whole map only at the end of a block.
Until then P = P0 - W'W is stored as P0 and the rows of W, two for each observation of the block. Only the entries of P
that the next observation needs are computed. This is exact.

For the right-invariant filter P = T (P0 - W'W) T' with T = I + u e_theta', u = J (state - anchor); the anchor is the
state to which P0 belongs. All rows of W are in the coordinates of the anchor, in which H becomes H T: only the column
of the heading differs. The anchor of a new landmark is its first estimate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels.augmentation import append_landmark
from slamgauge.ekf.kernels.belief import Belief, at_place, resized
from slamgauge.ekf.kernels.blas import subtract_gram
from slamgauge.ekf.kernels.corrections import move_additively, move_invariantly, transform_covariance
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
from slamgauge.ekf.kernels.workspace import Workspace
from slamgauge.jit import inner, kernel
from slamgauge.sensor_kernels import HAS_RANGE

ROBOT_ALONE = np.zeros(0, dtype=np.int64)
NEW = -2  # landmark of an observation that maps a new one


class Sequential(NamedTuple):
    """Form of the correction with a single observation."""

    invariant: bool = False  # True for the right-invariant filter
    passes: int = 1  # largest number of linearisations of an observation; above 1 for the iterated filter


class Gates(NamedTuple):
    """Gates on the squared Mahalanobis distance of an observation and a landmark, and the tails of the noise."""

    same: float  # largest distance of an association
    new: float  # at least `same`; an observation this close to a landmark that the scan has not observed maps nothing
    tails: float = math.inf  # degrees of freedom of the noise (see `student_t_weights`)


class SequentialUpdate(NamedTuple):
    """Result of `update_sequentially`."""

    slots: Int  # (m,) landmark of each observation, or NONE
    nis: float  # not finite if no update exists
    dof: int  # degrees of freedom of the NIS
    size: int  # number of state entries, including new landmarks


class Step(NamedTuple):
    """The observation that is processed, and its block."""

    sensor: int
    form: Sequential
    work: Workspace
    anchor: Float  # (capacity,) the state to which P0 belongs, for the right-invariant filter
    rows: int  # number of rows of W that earlier observations have filled
    row: int  # index of this observation
    one: Int  # (1,) slot of the landmark that this observation is compared with
    g: Float  # (2, rows) work space for H W'
    blind: Marks  # (1,) True if the bearing lost its information in the search for a minimum


class Compared(NamedTuple):
    """An observation compared with a landmark, as views of `Step.g` and of its rows in the workspace."""

    v: Float  # (2,) innovation
    h: Float  # (2, 5) Jacobian
    g: Float  # (2, rows) H W'
    informative: int  # rows with information
    s00: float  # innovation covariance
    s01: float
    s11: float


@kernel
def update_sequentially(
    sensor: int, belief: Belief, count: int, gates: Gates, form: Sequential, work: Workspace
) -> SequentialUpdate:
    """Associate, correct and map with the first `count` observations of `work`, one after the other.

    An observation may be an outlier if it is farther than `gates.same` from every landmark, but within `gates.new` of a
    landmark that this scan has not observed. It then neither corrects nor maps. The belief needs capacity for `count`
    new landmarks.
    """
    slots = np.full(count, NONE)
    if not are_sound(sensor, work.observation[:count], work.observation_cov[:count]):
        return SequentialUpdate(slots, math.nan, 0, belief.size)
    anchor = belief.state.copy() if form.invariant else np.empty(0)
    one, g, blind = np.zeros(1, dtype=np.int64), np.zeros((2, len(work.W))), np.zeros(1, dtype=np.bool_)
    nis, informative, rows = 0.0, 0, 0
    for i in range(count):
        if rows + 2 > len(work.W):
            if not _apply_block(belief, rows, form, anchor, work):
                return SequentialUpdate(slots, EXHAUSTED, informative, belief.size)
            if form.invariant:
                anchor = belief.state.copy()
            rows = 0
        blind[0] = False
        step = Step(sensor, form, work, anchor, rows, i, one, g, blind)
        slot = _nearest(step, belief, gates, slots)
        if slot == NEW:
            _append(step, belief)
            slot = (belief.size - 3) // 2
            belief = resized(belief, belief.size + 2)
        elif slot != NONE:
            one[0] = slot
            if gates.tails < math.inf:
                scale = inflation(sensor, _distance(_compare(step, belief)), gates.tails)
                for entry in range(4):
                    work.observation_cov[i, entry // 2, entry % 2] *= scale
            added, dof = _update(step, belief)
            if not math.isfinite(added):
                return SequentialUpdate(slots, added, informative, belief.size)
            nis, informative, rows = nis + added, informative + dof, rows + 2
        slots[i] = slot
    if not _apply_block(belief, rows, form, anchor, work):
        return SequentialUpdate(slots, EXHAUSTED, informative, belief.size)
    return SequentialUpdate(slots, nis, informative, belief.size)


@inner
def _apply_block(belief: Belief, rows: int, form: Sequential, anchor: Float, work: Workspace) -> bool:
    """P <- T (P0 - W'W) T' for the first `rows` rows of W.

    Returns False, with P unchanged, if a variance of the robot would be only rounding.
    """
    if rows == 0:
        return True
    if are_variances_lost(belief.cov, ROBOT_ALONE, work.W, rows):
        return False
    subtract_gram(belief.cov, work.W, rows, belief.size)
    mirror_robot_block(belief.cov)
    if form.invariant:
        transform_covariance(belief, _moved_from(anchor, belief), work.deferred)
    return True


@inner
def _moved_from(anchor: Float, belief: Belief) -> Float:
    """Return u (size,) with J (state - anchor) for every point."""
    state, u = belief.state, np.empty(belief.size)
    u[0], u[1], u[2] = anchor[1] - state[1], state[0] - anchor[0], 0.0
    for j in range(3, belief.size, 2):
        u[j], u[j + 1] = anchor[j + 1] - state[j + 1], state[j] - anchor[j]
    return u


@inner
def _compare(step: Step, belief: Belief) -> Compared:
    """Linearise the observation for the landmark in slot `step.one`, and compute its innovation covariance."""
    work, i = step.work, step.row
    v, h = work.innovation[2 * i : 2 * i + 2], work.jacobian[2 * i : 2 * i + 2]
    informative = linearise(step.sensor, belief, step.one, work.observation[i : i + 1], v, h)
    silence(step.blind, v, h)
    landmark = 3 + 2 * step.one[0]
    if step.form.invariant:
        _turn_to_anchor(belief.state, step.anchor, landmark, h)
    s00, s01, s11 = projected(belief.cov, h, landmark)
    g = step.g
    for k in range(step.rows):
        w = work.W[k]
        for a in range(2):
            g[a, k] = h[a, 0] * w[0] + h[a, 1] * w[1] + h[a, 2] * w[2]
            g[a, k] += h[a, 3] * w[landmark] + h[a, 4] * w[landmark + 1]
        s00 -= g[0, k] * g[0, k]
        s01 -= g[0, k] * g[1, k]
        s11 -= g[1, k] * g[1, k]
    r00, r01, r11 = noise(work.observation_cov[i], h[1])
    return Compared(v, h, g, informative, s00 + r00, s01 + r01, s11 + r11)


@inner
def _distance(pair: Compared) -> float:
    """Return the squared Mahalanobis distance of the observation and the landmark."""
    return squared_distance(pair.v[0], pair.v[1], pair.s00, pair.s01, pair.s11)


@inner
def _turn_to_anchor(state: Float, anchor: Float, landmark: int, h: Float) -> None:
    """H <- H T: transform H to the coordinates of the anchor."""
    for k in range(2):
        h[k, 2] += h[k, 0] * (anchor[1] - state[1]) + h[k, 1] * (state[0] - anchor[0])
        h[k, 2] += h[k, 3] * (anchor[landmark + 1] - state[landmark + 1])
        h[k, 2] += h[k, 4] * (state[landmark] - anchor[landmark])


@inner
def _nearest(step: Step, belief: Belief, gates: Gates, slots: Int) -> int:
    """Return the slot of the nearest landmark within the gate, NEW if no landmark is near, or NONE for an outlier.

    `slots` (m,) contains the landmarks of earlier observations of the scan.
    """
    work, i, one = step.work, step.row, step.one
    reach = reach_of(step.sensor, work.observation[i], work.observation_cov[i], belief.cov)
    if step.form.invariant:  # P0 belongs to the anchor: an error of its heading rotates the positions
        heading = math.sqrt(max(belief.cov[2, 2], 0.0))
        reach = Reach(reach.measured, reach.noise, reach.robot, heading)
    slot, least, doubtful = NONE, math.inf, False
    for landmark in range(3, belief.size, 2):
        if not is_within_reach(reach, belief, landmark, _lever(step, belief, landmark), gates.new):
            continue
        one[0] = (landmark - 3) // 2
        distance = _distance(_compare(step, belief))
        if not distance <= gates.new:
            continue
        if distance < least:
            slot, least = one[0], distance
        doubtful = doubtful or not _is_among(slots, i, one[0])
    if least <= gates.same:
        return slot
    return NONE if doubtful else NEW


@inner
def _lever(step: Step, belief: Belief, landmark: int) -> float:
    """Return an upper bound of the change of the measurement with the heading of P0 [m/rad]."""
    lever = 0.0
    if step.form.invariant:
        state, anchor = belief.state, step.anchor
        lever += math.hypot(state[0] - anchor[0], state[1] - anchor[1])
        lever += math.hypot(state[landmark] - anchor[landmark], state[landmark + 1] - anchor[landmark + 1])
    if not HAS_RANGE[step.sensor]:
        point = belief.point
        lever += math.hypot(point[landmark] - point[0], point[landmark + 1] - point[1])
    return lever


@inner
def _is_among(slots: Int, i: int, slot: int) -> bool:
    """Return whether one of the first i observations has the landmark in `slot`."""
    for k in range(i):  # noqa: SIM110 numba compiles no generator expressions
        if slots[k] == slot:
            return True
    return False


@inner
def _append(step: Step, belief: Belief) -> None:
    """Map a new landmark at the observation: append its columns of P0 and of W."""
    work, state, x, y = step.work, belief.state, belief.size, belief.size + 1
    reference = step.anchor if step.form.invariant else belief.point
    append_landmark(step.sensor, belief, reference, work.observation[step.row], work.observation_cov[step.row])
    lever_x, lever_y = state[x] - reference[0], state[y] - reference[1]
    for k in range(step.rows):
        w = work.W[k]
        w[x] = w[0] - lever_y * w[2]
        w[y] = w[1] + lever_x * w[2]


@inner
def _update(step: Step, belief: Belief) -> tuple[float, int]:
    """Correct the state with the observation and add two rows to W; return the NIS and its degrees of freedom."""
    if step.form.passes > 1:
        return _iterate(step, belief)
    dx = np.empty(belief.size)
    nis, informative = _gain(step, belief, belief, dx)
    if not math.isfinite(nis):
        return nis, informative
    if step.form.invariant:
        u = _moved_from(step.anchor, belief)
        for j in range(belief.size):
            dx[j] += u[j] * dx[2]
        move_invariantly(belief, dx)
    else:
        move_additively(belief.state, belief.size, dx)
    return nis, informative


@inner
def _iterate(step: Step, belief: Belief) -> tuple[float, int]:
    """Move the state to a minimum of the cost of prior and observation; return the same as `_update`."""
    work, i, state, dx = step.work, step.row, belief.state, np.empty(belief.size)
    nis, informative = _gain(step, belief, at_place(belief, state), dx)
    if not math.isfinite(nis):
        return nis, informative
    entries, local = involved_entries(step.one)
    P, minimum = block(belief.cov, entries), state[entries]
    for k in range(step.rows):
        w = work.W[k]
        for a in range(len(entries)):
            for b in range(len(entries)):
                P[a, b] -= w[entries[a]] * w[entries[b]]
    seen = Seen(step.sensor, local, work.observation[i : i + 1], work.observation_cov[i : i + 1], step.blind)
    if not find_minimum(minimum, P, seen, step.form.passes):
        return NO_MINIMUM, informative
    place = np.zeros(belief.size)  # entries that the observation does not involve are not read
    for a in range(len(entries)):
        place[entries[a]] = minimum[a]
    last, _ = _gain(step, belief, at_place(belief, place), dx)
    if not math.isfinite(last):
        return last, informative
    move_additively(belief.state, belief.size, dx)
    return nis, informative


@inner
def _gain(step: Step, belief: Belief, there: Belief, dx: Float) -> tuple[float, int]:
    """Add two rows to W and fill dx, with Jacobians of the belief `there`; return the NIS and its dof."""
    work, size, landmark = step.work, belief.size, 3 + 2 * step.one[0]
    W, pair = work.W[step.rows : step.rows + 2], _compare(step, there)
    v, h, s00, s01, s11 = pair.v, pair.h, pair.s00, pair.s01, pair.s11
    if step.form.passes > 1:
        _refer_to_prior(belief.state, there.state, landmark, h, v)
    if not (s00 > 0.0 and s00 * s11 - s01 * s01 > 0.0):
        return math.nan, pair.informative
    project_covariance(belief.cov, size, step.one, h, W)
    u00 = math.sqrt(s00)
    u01 = s01 / u00
    left = s11 - u01 * u01
    if left <= LEAST * s11:
        return EXHAUSTED, pair.informative
    u11 = math.sqrt(left)
    y0 = v[0] / u00
    y1 = (v[1] - u01 * y0) / u11
    for r in range(step.rows):
        g0, g1, w = pair.g[0, r], pair.g[1, r], work.W[r]
        for j in range(size):
            W[0, j] -= g0 * w[j]
            W[1, j] -= g1 * w[j]
    for j in range(size):
        W[0, j] /= u00
        W[1, j] = (W[1, j] - u01 * W[0, j]) / u11
        dx[j] = W[0, j] * y0 + W[1, j] * y1
    return y0 * y0 + y1 * y1, pair.informative


@inner
def _refer_to_prior(state: Float, place: Float, landmark: int, h: Float, v: Float) -> None:
    """Subtract H (state - place) from the innovation v, which was computed at `place`."""
    for k in range(2):
        for j in range(3):
            v[k] -= h[k, j] * (state[j] - place[j])
        for j in range(2):
            v[k] -= h[k, 3 + j] * (state[landmark + j] - place[landmark + j])
