"""Nearest-neighbour association as in the exercise: for each observation, associate, then correct or map; compiled.

Every observation changes the state immediately, but the covariance of the whole map only when a block of observations
is full: until then its changes are pending rows (see `update`). This is exact.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Int
from slamgauge.ekf.kernels.augmentation import append_landmark
from slamgauge.ekf.kernels.belief import NONE, ROBOT, Belief, Pending, Workspace, resized
from slamgauge.ekf.kernels.covariance import own_covariance, squared_distance
from slamgauge.ekf.kernels.individual_compatibility import Reach, is_within_reach, reach_of
from slamgauge.ekf.kernels.linearisation import linearise
from slamgauge.ekf.kernels.soundness import are_sound
from slamgauge.ekf.kernels.student_t import inflate
from slamgauge.ekf.kernels.update import (
    Form,
    apply,
    correction,
    iterate,
    move_additively,
    move_invariantly,
    seen_by,
)
from slamgauge.formula_kernels import HAS_RANGE
from slamgauge.jit import inner, kernel

NEW = -2  # landmark of an observation that maps a new one


class Gates(NamedTuple):
    """Gates on the squared Mahalanobis distance of an observation and a landmark."""

    same: float  # largest distance of an association
    new: float  # at least `same`; an observation this close to a landmark that the scan has not observed maps nothing


class SequentialUpdate(NamedTuple):
    """Result of `update_nearest`."""

    slots: Int  # (m,) landmark of each observation, or NONE
    nis: float  # not finite if no update exists
    dof: int  # degrees of freedom of the NIS
    size: int  # number of state entries, including new landmarks
    passes: int  # most passes of the iterated filter for an observation


@kernel
def update_nearest(
    sensor: int, belief: Belief, count: int, gates: Gates, form: Form, work: Workspace
) -> SequentialUpdate:
    """Associate, correct and map with the first `count` observations of `work`, one after the other.

    An observation may be an outlier if it is farther than `gates.same` from every landmark, but within `gates.new` of a
    landmark that this scan has not observed. It then neither corrects nor maps. The belief needs capacity for `count`
    new landmarks.
    """
    slots = work.slots[:count]
    slots[:] = NONE
    if not are_sound(sensor, work.observation[:count], work.observation_cov[:count]):
        return SequentialUpdate(slots, math.nan, 0, belief.size, 1)
    block, dx = len(work.S) // 2, np.empty(len(belief.state))
    nis, informative, passes, pending = 0.0, 0, 1, Pending(0, 0)
    for i in range(count):
        if pending.rows == 2 * block:
            apply(belief, pending, work)
            pending = Pending(0, 0)
        slot, distance = nearest(sensor, belief, i, gates, pending, work)
        slots[i] = slot
        if slot == NEW:
            append_landmark(sensor, belief, belief.point, work.observation[i], work.observation_cov[i])
            _append_pending(belief, pending, work)
            slots[i] = (belief.size - ROBOT) // 2
            belief = resized(belief, belief.size + 2)
        elif slot != NONE:
            if form.tails < math.inf:
                inflate(sensor, distance, form.tails, work.observation_cov[i])
            informative += _linearise_one(sensor, belief, slots[i : i + 1], i, work)
            added = correction(belief, (i, i + 1), pending, work, dx)
            nis += added
            if form.iterated and math.isfinite(nis):
                last, needed = iterate(sensor, belief, (i, i + 1), pending, work, dx)
                nis, passes = nis if math.isfinite(last) else last, max(passes, needed)
            if not math.isfinite(nis):
                return SequentialUpdate(slots, nis, informative, belief.size, passes)
            pending = Pending(pending.rows + 2, pending.pairs)
            if form.invariant:
                move_invariantly(belief, dx, pending, work)
                pending = Pending(pending.rows, pending.pairs + 1)
            else:
                move_additively(belief, dx)
    apply(belief, pending, work)
    return SequentialUpdate(slots, nis, informative, belief.size, passes)


@inner
def nearest(sensor: int, belief: Belief, i: int, gates: Gates, pending: Pending, work: Workspace) -> tuple[int, float]:
    """Return the slot of the nearest landmark to observation i and its distance.

    The slot is NEW if no landmark is near, and NONE for an outlier.
    """
    reach = reach_of(sensor, work.observation[i], work.observation_cov[i], belief.cov)
    if pending.pairs:  # the covariance belongs to an earlier state: an error of its heading moves the positions
        reach = Reach(reach.measured, reach.noise, reach.robot, math.sqrt(max(belief.cov[2, 2], 0.0)))
    found, least, doubtful, one = NONE, math.inf, False, np.empty(1, dtype=np.int64)
    for slot in range((belief.size - ROBOT) // 2):
        landmark = ROBOT + 2 * slot
        if not is_within_reach(reach, belief, landmark, _lever(sensor, belief, landmark, pending, work), gates.new):
            continue
        one[0] = slot
        distance = distance_to(sensor, belief, i, one, pending, work)
        if not distance <= gates.new:
            continue
        if distance < least:
            found, least = slot, distance
        doubtful = doubtful or not _is_among(work.slots, i, slot)
    if least <= gates.same:
        return found, least
    return (NONE if doubtful else NEW), least


@inner
def _linearise_one(sensor: int, belief: Belief, one: Int, i: int, work: Workspace) -> int:
    """Linearise observation i at the landmark in slot `one` (1,); return the number of rows with information."""
    v, h = work.innovation[2 * i : 2 * i + 2], work.jacobian[2 * i : 2 * i + 2]
    return linearise(sensor, belief, one, work.observation[i : i + 1], v, h)


@inner
def distance_to(sensor: int, belief: Belief, i: int, one: Int, pending: Pending, work: Workspace) -> float:
    """Return the squared Mahalanobis distance of observation i and the landmark in slot `one` (1,)."""
    _linearise_one(sensor, belief, one, i, work)
    v, h, landmark = work.innovation[2 * i : 2 * i + 2], work.jacobian[2 * i : 2 * i + 2], ROBOT + 2 * one[0]
    s00, s01, s11 = own_covariance(belief.cov, h, landmark, work.observation_cov[i])
    for r in range(pending.rows):
        g0, g1 = seen_by(h[0], work.W[r], landmark), seen_by(h[1], work.W[r], landmark)
        s00, s01, s11 = s00 - g0 * g0, s01 - g0 * g1, s11 - g1 * g1
    for r in range(pending.pairs):
        u0, u1 = seen_by(h[0], work.u[r], landmark), seen_by(h[1], work.u[r], landmark)
        a0, a1 = seen_by(h[0], work.a[r], landmark), seen_by(h[1], work.a[r], landmark)
        s00, s01, s11 = s00 + 2.0 * u0 * a0, s01 + u0 * a1 + a0 * u1, s11 + 2.0 * u1 * a1
    return squared_distance(v[0], v[1], s00, s01, s11)


@inner
def _lever(sensor: int, belief: Belief, landmark: int, pending: Pending, work: Workspace) -> float:
    """Return an upper bound of the change of the measurement with the heading of `cov` [m/rad].

    A position in the body frame depends on the heading; pending pairs mix it into the positions.
    """
    lever, point = 0.0, belief.point
    if not HAS_RANGE[sensor]:
        lever = math.sqrt((point[landmark] - point[0]) ** 2 + (point[landmark + 1] - point[1]) ** 2)
    for r in range(pending.pairs):
        u = work.u[r]
        lever += math.sqrt(u[landmark] ** 2 + u[landmark + 1] ** 2) + math.sqrt(u[0] ** 2 + u[1] ** 2)
    return lever


@inner
def _append_pending(belief: Belief, pending: Pending, work: Workspace) -> None:
    """Append the columns of a new landmark, which `append_landmark` has just written, to the pending rows."""
    x, y = belief.size, belief.size + 1
    lever_x, lever_y = belief.state[x] - belief.point[0], belief.state[y] - belief.point[1]
    for r in range(pending.rows):
        w = work.W[r]
        w[x], w[y] = w[0] - lever_y * w[2], w[1] + lever_x * w[2]
    for r in range(pending.pairs):
        for row in (work.u[r], work.a[r]):
            row[x], row[y] = row[0] - lever_y * row[2], row[1] + lever_x * row[2]


@inner
def _is_among(slots: Int, i: int, slot: int) -> bool:
    """Return whether one of the first i observations has the landmark in `slot`."""
    for k in range(i):  # noqa: SIM110 numba compiles no generator expressions
        if slots[k] == slot:
            return True
    return False
