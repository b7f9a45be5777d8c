"""Compilation before the first step of a sliding window, with a message if it takes long."""

from __future__ import annotations

import functools

import numpy as np

from slamgauge.ekf.advanced.window import cost, passes
from slamgauge.ekf.kernels.joint_update import are_sound
from slamgauge.ekf.kernels.prediction import is_semidefinite
from slamgauge.kernel_cache import compiling
from slamgauge.sensor_kernels import locate_all
from slamgauge.triangulation import triangulate


@functools.cache
def compile_window_once() -> None:
    """Compile (or load from the cache) every kernel of the sliding window, once per process."""
    A, b, rest = np.eye(5), np.zeros(5), np.array([1.0, 0.0])
    prior = cost.Prior(np.eye(5), np.zeros(5), np.zeros(5))
    poses = cost.Window(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3, 3)))
    one = cost.Observed(0, np.array([0]), np.array([[1.0, 0.0]]), np.eye(2)[None])
    none = cost.Observed(0, np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)))
    seen, kept = cost.ObservedByPose(np.array([0, 0, 1]), one), cost.ObservedByPose(np.array([0]), none)
    work, step = passes.allocate_pass(2, 5), np.zeros(5)
    problem = cost.Problem(prior, poses, seen, kept, rest, 1)
    with compiling("sliding-window kernels", 40):
        is_semidefinite(np.zeros((3, 3)))
        are_sound(0, np.ones((1, 2)), np.eye(2)[None])
        locate_all(0, np.ones((1, 2)))
        triangulate(np.zeros((1, 3)), np.zeros(1), np.ones(1), 1.0)
        passes.sweep(problem, A, b, work)
        passes.solve(5, A, b, step, np.zeros((3, 3)))
        passes.go_back(poses, 5, step, work)
        cost.chain(poses)
        cost.twice_cost(problem)
        passes.add_first(problem, A, b)
        passes.move_on(poses, 1, 5, A, b, work)
        passes.set_prior(poses.pose[1], rest, 1, A, b, prior)
        cost.rebase(prior, poses.pose[1], rest, 1)
