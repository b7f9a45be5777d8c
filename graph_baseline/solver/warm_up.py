"""Compilation before the first optimum, with a message if it takes long."""

from __future__ import annotations

import functools

import numpy as np

from slamgauge.graph_baseline.problem.residuals import Measured
from slamgauge.graph_baseline.solver import chord_kernels, linear_problem, pose_elimination, recursions
from slamgauge.kernel_cache import compiling
from slamgauge.sensors import SENSORS
from slamgauge.triangulation import triangulate


@functools.cache
def compile_graphs_once() -> None:
    """Compile (or load from the cache) every kernel of the graphs, once per process."""
    measured = _one_observation()
    state, linear = linear_problem.allocate_state(1, 1), linear_problem.allocate_linear(1, 1, 1, 2)
    step = chord_kernels.allocate_chord(1, 1, 1, 2)
    state.landmarks[0] = measured.value[0]
    with compiling("graph kernels", 52):
        pose_elimination.eliminate_poses(measured, linear, state, state, 1, (0, 1))
        pose_elimination.newest_covariance(linear, np.eye(2), np.empty((3, 3)))
        chord_kernels.compute_defects(measured, linear, state, 0, step)
        chord_kernels.smooth(linear, 0, step)
        chord_kernels.subtract_pose_step(measured, linear, 0, step)
        chord_kernels.subtract_landmark_step(measured, linear, 0, step)
        chord_kernels.predict_changes(measured, linear, 0, step)
        chord_kernels.move(measured, state, 0, 1, step)
        one = np.zeros((1, 3, 3))
        triangulate(np.zeros((1, 3)), np.zeros(1), np.ones(1), 1.0)
        recursions.run_covariances(
            np.eye(3), one[:0], one[:0], one, recursions.FilterCovariances(*np.zeros((5, 1, 3, 3)))
        )
        recursions.run_maps(one, one)
        recursions.run_adjoints(one, one, one)


def _one_observation() -> Measured:
    """Return a pose that observes one landmark, with the array types of every recording."""
    value = np.array([[1.0, 0.0]])
    value.setflags(write=False)
    return Measured(
        sensor=SENSORS["position"].code,
        start=np.zeros(3),
        motion=np.zeros((1, 3)),
        motion_turn=np.array([[1.0, 0.0]]),
        motion_cov=np.eye(3)[None],
        first=np.array([0, 1]),
        value=value,
        direction=np.array([[1.0, 0.0]]),
        whitener=np.eye(2)[None],
        slot=np.array([0]),
    )
