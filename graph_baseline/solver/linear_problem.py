"""Arrays of the linear system of an incremental optimum."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float


class State(NamedTuple):
    """A path and a map; used entries come first."""

    poses: Float  # (N+1, 3)
    landmarks: Float  # (L, 2)


class Linear(NamedTuple):
    """Matrices of the eliminated poses, linearised at `at`."""

    at: State
    lever: Float  # (N+1, 2) lever of F = [I, lever; 0, 1], the motion to pose k
    P: Float  # (N+1, 3, 3) predicted covariance
    N: Float  # (N+1, 3, 3) Hx' Hx of the scan
    G: Float  # (N+1, 3, 3) (I + P N)^-1
    Hx: Float  # (M, d, 3) whitened
    Hm: Float  # (M, d, 2) whitened
    M: Float  # (3, 2L) sensitivity of the newest pose to the landmarks, after its scan
    newest_cov: Float  # (3, 3) covariance of the newest pose given the landmarks, after its scan
    information: Float  # (2L, 2L) Lambda, lower triangle
    rhs: Float  # (2L,) right-hand side of the landmarks from residuals of the newest scan
    pose_step: Float  # (3,) step of the newest pose, given the landmarks


def allocate_state(poses: int, landmarks: int) -> State:
    """Allocate a path and a map."""
    return State(np.zeros((poses, 3)), np.zeros((landmarks, 2)))


def allocate_linear(poses: int, landmarks: int, observations: int, dim: int) -> Linear:
    """Allocate the matrices of all poses and of observations (M, dim)."""
    width = 2 * landmarks
    return Linear(
        at=allocate_state(poses, landmarks),
        lever=np.zeros((poses, 2)),
        P=np.zeros((poses, 3, 3)),
        N=np.zeros((poses, 3, 3)),
        G=np.zeros((poses, 3, 3)),
        Hx=np.zeros((observations, dim, 3)),
        Hm=np.zeros((observations, dim, 2)),
        M=np.zeros((3, width)),
        newest_cov=np.zeros((3, 3)),
        information=np.zeros((width, width)),
        rhs=np.zeros(width),
        pose_step=np.zeros(3),
    )
