"""Compilation of kernels before the first step, with a message if it takes long.

Each function calls its kernels once with a small map, so that a filter's steps contain no compilation time.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from slamgauge.ekf.kernels import map_edits
from slamgauge.ekf.kernels.augmentation import augment
from slamgauge.ekf.kernels.belief import Belief, allocate_belief
from slamgauge.ekf.kernels.corrections import update_standard
from slamgauge.ekf.kernels.deferred_downdate import apply_deferred
from slamgauge.ekf.kernels.individual_compatibility import allocate_pairs, find_compatible, find_located
from slamgauge.ekf.kernels.joint_compatibility import Limits, mark_ambiguous, search_jointly
from slamgauge.ekf.kernels.joint_update import are_sound
from slamgauge.ekf.kernels.linear_update import append_linear, linear_update
from slamgauge.ekf.kernels.linearisation import innovations_of
from slamgauge.ekf.kernels.prediction import predict
from slamgauge.ekf.kernels.sequential_association import Gates, Sequential, update_sequentially
from slamgauge.ekf.kernels.slots import find_slots
from slamgauge.ekf.kernels.student_t_weights import inflate_noise
from slamgauge.ekf.kernels.workspace import Workspace, allocate
from slamgauge.jit import direct
from slamgauge.kernel_cache import compiling
from slamgauge.triangulation import triangulate


@functools.cache
def compile_steps(update: Callable[..., object], *, heavy_tails: bool) -> None:
    """Compile (or load from the cache) the kernels of every step of a filter, once per process.

    Args:
        update: correction kernel of the filter, for example `update_standard`.
        heavy_tails: whether the filter inflates noise by Student-t weights.
    """
    belief, work = _robot_and_landmark()
    with compiling("filter kernels", 50):
        predict(belief, np.zeros(3), np.zeros((3, 3)))
        augment(0, belief._replace(size=3), work.observation, work.observation_cov)
        find_slots(work.ids, work.slots, work.ids, work.slots)
        are_sound(0, work.observation, work.observation_cov)
        direct(update, 0, belief, 1, work)
        apply_deferred(belief.cov, belief.size, work.deferred)
        if heavy_tails:
            inflate_noise(0, belief, work.slots, work.observation, work.observation_cov, 4.0)


def compile_ekf() -> None:
    """Compile the kernels of the standard filter."""
    compile_steps(update_standard, heavy_tails=False)


@functools.cache
def compile_nearest_neighbour() -> None:
    """Compile the kernels of association by the nearest neighbour."""
    belief, work = _robot_and_landmark()
    with compiling("association kernels", 40):
        update_sequentially(0, belief, 1, Gates(9.0, 9.0), Sequential(), work)


@functools.cache
def compile_joint_association() -> None:
    """Compile the kernels of joint association."""
    belief, _ = _robot_and_landmark()
    values, covs, mark = np.array([[1.0, 0.0]]), np.eye(2)[None], np.zeros(2, dtype=np.bool_)
    pairs, quantiles = allocate_pairs(1), np.array([0.0, 9.0])
    with compiling("association kernels", 20):
        find_compatible(0, belief, values, covs, 9.0, pairs)
        find_located(belief.cov, covs, pairs, 9.0, mark)
        slots, _ = search_jointly(belief.cov, covs, pairs, 9.0, quantiles, 1)
        mark_ambiguous(belief.cov, covs, pairs, slots, Limits(9.0, 0.0, 1))


@functools.cache
def compile_map_edits(retract: Callable[..., object]) -> None:
    """Compile the kernels that remove and merge landmarks, and the kernel `retract` that applies a correction."""
    belief, work = _robot_and_landmark()
    with compiling("map-edit kernels", 5):
        both = belief._replace(size=7)
        map_edits.find_duplicates(both, work.slots[:1], np.zeros((2, 2), dtype=np.bool_), 9.0)
        map_edits.equate_landmarks(both, 0, 1)
        map_edits.remove_landmark(both, 0)
        retract(belief, np.zeros(belief.size), work.deferred)


@functools.cache
def compile_bearings(retract: Callable[..., object]) -> None:
    """Compile the kernels of bearing-only landmarks, and the kernel `retract` that applies a correction."""
    belief, work = _robot_and_landmark()
    columns, jacobian, one = np.arange(3), np.zeros((1, 3)), np.ones((1, 1))
    with compiling("bearing-only kernels", 7):
        innovations_of(2, belief, work.slots, work.observation, work.observation_cov)
        append_linear(belief._replace(size=3), columns, np.zeros((2, 3)), np.eye(2))
        linear_update(belief, columns, jacobian, np.zeros(1), one)
        map_edits.remove_landmark(belief, 0)
        retract(belief, np.zeros(belief.size), work.deferred)
        triangulate(np.zeros((1, 3)), np.zeros(1), np.ones(1), 1.0)


def _robot_and_landmark() -> tuple[Belief, Workspace]:
    """Return a belief with one landmark and capacity for two, and a workspace with one observation."""
    belief, work = allocate_belief(2), allocate(1, 7, 1)
    belief.cov[:] = np.eye(7)
    work.observation[:] = 1.0, 0.0
    work.observation_cov[:] = np.eye(2)
    return belief._replace(size=5), work
