"""Small valid records; tests change one field at a time to an invalid value."""

from __future__ import annotations

from typing import Any

import numpy as np

from slamgauge.estimate import Estimate, MapHistory, RayLog
from slamgauge.recording import Recording
from slamgauge.truth import Truth


def recording(**changes: Any) -> Recording:
    """Return a recording of three poses and three observations, valid except for `changes`."""
    values: dict[str, Any] = {
        "stamps": [0.0, 0.1, 0.2],
        "prior_mean": [0.0, 0.0, 0.0],
        "prior_cov": np.diag([0.01, 0.01, 1e-4]),
        "odometry": [[0.1, 0.0, 0.01], [0.1, 0.0, 0.01]],
        "odometry_cov": np.tile(np.diag([1e-3, 0.0, 1e-5]), (2, 1, 1)),
        "sensor": "range-bearing",
        "observation_step": [0, 1, 1],
        "observation": [[2.0, 0.1], [3.0, -0.2], [1.0, 3.1]],
        "observation_cov": np.tile(np.diag([0.01, 0.007]), (3, 1, 1)),
        "landmark": [4, 4, 9],
    }
    return Recording(**(values | changes))


def truth(**changes: Any) -> Truth:
    values: dict[str, Any] = {
        "poses": np.zeros((3, 3)),
        "landmark_ids": [4, 9],
        "landmarks": [[1.0, 2.0], [3.0, 4.0]],
        "association": [4, 4, 9],
    }
    return Truth(**(values | changes))


def estimate(**changes: Any) -> Estimate:
    values: dict[str, Any] = {
        "kind": "filtered",
        "poses": np.zeros((3, 3)),
        "pose_covs": np.tile(np.eye(3), (3, 1, 1)),
        "landmark_ids": [9, 4],
        "landmarks": [[1.0, 2.0], [3.0, 4.0]],
        "landmark_covs": np.tile(np.eye(2), (2, 1, 1)),
        "association": [4, -1, 9],
        "nis": [0.0, 1.5, 2.0],
        "nis_dof": [0, 2, 2],
        "seconds": [0.0, 1e-4, 1e-4],
    }
    return Estimate(**(values | changes))


def rays(**changes: Any) -> RayLog:
    """Return two rays on the path of `estimate`: one became a point, the other still exists."""
    values: dict[str, Any] = {
        "landmark": [9, 4],
        "birth": [0, 1],
        "end": [2, -1],
        "survivor": [1, -1],
        "distances": [[1.0, 2.0, 4.0], [1.0, 2.0, np.nan]],
        "members": [3, 5, 2],
    }
    return RayLog(**(values | changes))


def history(**changes: Any) -> MapHistory:
    """Return a point at two steps of the path of `estimate`."""
    values: dict[str, Any] = {
        "step": [0, 2],
        "landmark": [9, 9],
        "member": [-1, -1],
        "weight": [1.0, 1.0],
        "position": [[1.0, 2.0], [1.1, 2.0]],
        "cov": np.tile(np.eye(2), (2, 1, 1)),
    }
    return MapHistory(**(values | changes))
