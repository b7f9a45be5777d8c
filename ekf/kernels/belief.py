"""A filter's belief: state, covariance and the point at which Jacobians are taken, as one argument of kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.jit import inner

ROBOT = 3  # entries of the robot: x, y, heading
NONE = -1  # no landmark, no slot, no member, no step
AT_POINT = 0  # form of Jacobians: evaluated at a belief's `point`, without projection


class Belief(NamedTuple):
    """State and covariance of robot and landmarks, with free capacity for new landmarks.

    The landmark in slot i has the entries 3 + 2i and 4 + 2i.
    """

    state: Float  # (capacity,) robot x, y [m], heading [rad], then two entries for each slot
    point: Float  # (capacity,) first estimates, at which Jacobians are taken; the same array as `state` if not used
    cov: Float  # (capacity, capacity) upper triangle; both triangles of the robot's block
    points: Marks  # (capacity // 2,) True if the slot is a position in the plane, which rotates with the map
    size: int  # entries in use: 3 + 2L
    form: int  # form of the observation Jacobians: AT_POINT or `linearisation.PROJECTED`


def allocate_belief(landmarks: int, *, first_estimates: bool = False, form: int = AT_POINT) -> Belief:
    """Return a robot at the origin with zero covariance and capacity for the given number of landmarks."""
    capacity = ROBOT + 2 * landmarks
    state = np.zeros(capacity)
    point = state.copy() if first_estimates else state
    marks = np.ones(capacity // 2, dtype=np.bool_)
    return Belief(state, point, np.zeros((capacity, capacity)), marks, ROBOT, form)


def enlarged(belief: Belief, size: int) -> Belief:
    """Return a copy of the belief with capacity for `2 * size` entries; unused pages of its arrays take no memory."""
    used, is_separate = belief.size, belief.point is not belief.state
    larger = allocate_belief(size, first_estimates=is_separate, form=belief.form)
    larger.state[:used], larger.point[:used] = belief.state[:used], belief.point[:used]
    larger.cov[:used, :used] = belief.cov[:used, :used]
    larger.points[: len(belief.points)] = belief.points
    return larger._replace(size=used)


@inner
def resized(belief: Belief, size: int) -> Belief:
    """Return a belief of the same arrays with `size` entries in use."""
    return Belief(belief.state, belief.point, belief.cov, belief.points, size, belief.form)


@inner
def at_place(belief: Belief, place: Float) -> Belief:
    """Return a belief with the same covariance and the state `place` (capacity,), where Jacobians are taken too."""
    return Belief(place, place, belief.cov, belief.points, belief.size, AT_POINT)


class Pending(NamedTuple):
    """Number of pending rows of W, and of pending pairs u, a: changes of P that `update.apply` makes later."""

    rows: int
    pairs: int


class Workspace(NamedTuple):
    """Arrays for a scan of up to m observations, updated in blocks of up to b observations.

    The caller of an update fills `slots`, `observation` and `observation_cov`; the update overwrites all other arrays.
    """

    ids: Int  # (m,)
    slots: Int  # (m,)
    observation: Float  # (m, 2)
    observation_cov: Float  # (m, 2, 2)
    jacobian: Float  # (2m, 5)
    innovation: Float  # (2m,)
    pivots: Float  # (2m,) see `update.correction`
    S: Float  # (2b, 2b)
    W: Float  # (2b, capacity)
    u: Float  # (b, capacity) see `Pending`
    a: Float  # (b, capacity)


def allocate_workspace(observations: int, capacity: int, block: int) -> Workspace:
    """Allocate arrays for `observations`, updated in blocks of at most `block`, and a state of `capacity` entries."""
    rows, block = 2 * observations, max(min(observations, block), 1)
    return Workspace(
        ids=np.zeros(observations, dtype=np.int64),
        slots=np.zeros(observations, dtype=np.int64),
        observation=np.zeros((observations, 2)),
        observation_cov=np.tile(np.eye(2), (observations, 1, 1)),  # the first row is constant for a bearing-only sensor
        jacobian=np.zeros((rows, 5)),
        innovation=np.zeros(rows),
        pivots=np.zeros(rows),
        S=np.zeros((2 * block, 2 * block)),
        W=np.zeros((2 * block, capacity)),
        u=np.zeros((block, capacity)),
        a=np.zeros((block, capacity)),
    )
