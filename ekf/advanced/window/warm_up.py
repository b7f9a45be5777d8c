"""Compilation before the first step of a sliding window, with a message if it takes long."""

from __future__ import annotations

import functools

import numpy as np

from slamgauge.ekf.advanced.window import kernels
from slamgauge.ekf.kernels.joint_update import are_sound
from slamgauge.ekf.kernels.prediction import is_semidefinite
from slamgauge.kernel_cache import compiling
from slamgauge.sensor_kernels import locate_all
from slamgauge.triangulation import triangulate


@functools.cache
def compile_window_once() -> None:
    """Compile (or load from the cache) every kernel of the sliding window, once per process."""
    A, b, rest = np.eye(5), np.zeros(5), np.array([1.0, 0.0])
    prior = kernels.Prior(np.eye(5), np.zeros(5), np.zeros(5))
    poses = kernels.Window(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3, 3)))
    one = kernels.Observed(0, np.array([0]), np.array([[1.0, 0.0]]), np.eye(2)[None])
    none = kernels.Observed(0, np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)))
    seen, kept = kernels.ObservedByPose(np.array([0, 0, 1]), one), kernels.ObservedByPose(np.array([0]), none)
    work, step = kernels.allocate_pass(2, 5), np.zeros(5)
    problem = kernels.Problem(prior, poses, seen, kept, rest, 1)
    with compiling("sliding-window kernels", 40):
        is_semidefinite(np.zeros((3, 3)))
        are_sound(0, np.ones((1, 2)), np.eye(2)[None])
        locate_all(0, np.ones((1, 2)))
        triangulate(np.zeros((1, 3)), np.zeros(1), np.ones(1), 1.0)
        kernels.sweep(problem, A, b, work)
        kernels.solve(5, A, b, step, np.zeros((3, 3)))
        kernels.go_back(poses, 5, step, work)
        kernels.chain(poses)
        kernels.cost(problem)
        kernels.add_first(problem, A, b)
        kernels.move_on(poses, 1, 5, A, b, work)
        kernels.set_prior(poses.pose[1], rest, 1, A, b, prior)
        kernels.rebase(prior, poses.pose[1], rest, 1)
