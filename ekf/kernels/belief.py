"""What a filter believes: state, covariance and where Jacobians are taken, as one value that kernels take."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Marks
from slamgauge.jit import kernel

ROBOT = 3  # entries of the robot: x, y, heading
AT_POINT = 0  # form of Jacobians: as they are at a belief's `point`


class Belief(NamedTuple):
    """State and covariance of robot and landmarks, with room for more.

    Landmark slot i takes up the entries 3 + 2i and 4 + 2i.
    """

    state: Float  # (capacity,) robot x, y [m], heading [rad], then two entries for each slot
    point: Float  # (capacity,) first estimates, at which Jacobians are taken; `state` itself in filters without them
    cov: Float  # (capacity, capacity) upper triangle, and the whole of the robot's block
    points: Marks  # (capacity // 2,) slots that hold a position in the plane, which turns with the map
    size: int  # entries in use: 3 + 2L
    form: int  # of the Jacobians of observations: AT_POINT, or another of `linearisation`


def allocate_belief(landmarks: int, *, first_estimates: bool = False, form: int = AT_POINT) -> Belief:
    """A robot at the origin, known exactly, with room for that many landmarks."""
    capacity = ROBOT + 2 * landmarks
    state = np.zeros(capacity)
    point = state.copy() if first_estimates else state
    marks = np.ones(capacity // 2, dtype=np.bool_)
    return Belief(state, point, np.zeros((capacity, capacity)), marks, ROBOT, form)


def enlarged(belief: Belief, size: int) -> Belief:
    """The same belief with room for `size` entries; untouched pages of the larger arrays cost no memory."""
    capacity, used = 2 * size, belief.size
    more = capacity - used
    state = np.pad(belief.state[:used], (0, more))
    point = state if belief.point is belief.state else np.pad(belief.point[:used], (0, more))
    cov = np.zeros((capacity, capacity))
    cov[:used, :used] = belief.cov[:used, :used]
    marks = np.ones(capacity // 2, dtype=np.bool_)
    marks[: len(belief.points)] = belief.points
    return Belief(state, point, cov, marks, used, belief.form)


@kernel
def resized(belief: Belief, size: int) -> Belief:
    """The same arrays with `size` entries in use."""
    return Belief(belief.state, belief.point, belief.cov, belief.points, size, belief.form)


@kernel
def at_place(belief: Belief, place: Float) -> Belief:
    """The same covariance about another place (capacity,), at which Jacobians are taken too."""
    return Belief(place, place, belief.cov, belief.points, belief.size, AT_POINT)
