"""EKF-SLAM in numpy, written for speed: the reference time of `slamgauge bench`.

One joint update per step, with a Cholesky factor and one product W'W; the prediction changes only the robot's rows.
`slamgauge.ekf.textbook` is the same filter written for reading: it takes 3 to 6 times as long for 20 to 600 landmarks.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np
from scipy.linalg import get_blas_funcs

from slamgauge.arrays import Float, Int
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import rotation, wrap

trsm, trsv = get_blas_funcs(("trsm", "trsv"))


def plain_numpy_ekf(recording: Recording) -> Estimate:
    """EKF-SLAM for `range-bearing` recordings whose landmark ids are 0..L-1."""
    assert recording.landmark is not None
    count = int(recording.landmark.max(initial=-1)) + 1
    state, cov = np.zeros(3 + 2 * count), np.zeros((3 + 2 * count, 3 + 2 * count))
    state[:3], cov[:3, :3] = recording.prior_mean, recording.prior_cov
    slot, size = np.full(count, -1), 3
    room = np.empty(cov.size)
    steps = recording.steps
    poses, pose_covs, seconds = np.empty((steps + 1, 3)), np.empty((steps + 1, 3, 3)), np.zeros(steps + 1)
    for k, (ids, values, covs) in enumerate(recording.scans()):
        assert ids is not None
        start = perf_counter()
        if k > 0:
            _predict(state, cov[:size, :size], recording.odometry[k - 1], recording.odometry_cov[k - 1])
        old = slot[ids] >= 0
        if old.any():
            gram = room[: size * size].reshape(size, size)
            _update(state[:size], cov[:size, :size], slot[ids[old]], values[old], covs[old], gram)
        for i in np.flatnonzero(~old):
            slot[ids[i]] = (size - 3) // 2
            _augment(state, cov, size, values[i], covs[i])
            size += 2
        seconds[k] = perf_counter() - start
        poses[k], pose_covs[k] = state[:3], cov[:3, :3]
    return Estimate(kind="filtered", poses=poses, pose_covs=pose_covs, seconds=seconds)


def _predict(state: Float, P: Float, increment: Float, Q: Float) -> None:
    turn = np.eye(3)
    turn[:2, :2] = rotation(state[2])
    moved = turn[:2, :2] @ increment[:2]
    F = np.array([[1.0, 0.0, -moved[1]], [0.0, 1.0, moved[0]], [0.0, 0.0, 1.0]])
    P[:3, :] = F @ P[:3, :]
    P[:, :3] = P[:, :3] @ F.T
    P[:3, :3] += turn @ Q @ turn.T
    state[:2] += moved
    state[2] = wrap(state[2] + increment[2])


def _update(state: Float, P: Float, slots: Int, z: Float, R: Float, gram: Float) -> None:
    rows = 2 * len(slots)
    landmarks = 3 + 2 * slots
    offset = np.column_stack([state[landmarks], state[landmarks + 1]]) - state[:2]
    distance = np.hypot(*offset.T)
    along = offset / distance[:, None]
    across = np.column_stack([-along[:, 1], along[:, 0]]) / distance[:, None]
    by_landmark = np.stack([along, across], axis=1)
    by_robot = np.zeros((len(slots), 2, 3))
    by_robot[:, :, :2] = -by_landmark
    by_robot[:, 1, 2] = -1.0
    by_robot = by_robot.reshape(rows, 3)
    bearing = np.arctan2(offset[:, 1], offset[:, 0]) - state[2]
    innovation = z - np.column_stack([distance, bearing])
    innovation[:, 1] = wrap(innovation[:, 1])
    HP = by_robot @ P[:3]
    HP += (by_landmark @ P[landmarks[:, None] + np.arange(2)]).reshape(rows, -1)
    S = HP[:, :3] @ by_robot.T
    HPx, HPy = HP[:, landmarks], HP[:, landmarks + 1]
    S[:, 0::2] += HPx * by_landmark[:, 0, 0] + HPy * by_landmark[:, 0, 1]
    S[:, 1::2] += HPx * by_landmark[:, 1, 0] + HPy * by_landmark[:, 1, 1]
    index = np.arange(len(slots))
    S.reshape(len(slots), 2, len(slots), 2)[index, :, index, :] += R
    factor = np.linalg.cholesky(S)
    W = trsm(1.0, factor.T, HP.T, side=1, overwrite_b=True)  # HP' L'^-1
    state += W @ trsv(factor.T, innovation.ravel(), trans=1)
    state[2] = wrap(state[2])
    P -= np.matmul(W, W.T, out=gram)


def _augment(state: Float, P: Float, size: int, z: Float, R: Float) -> None:
    angle = state[2] + z[1]
    direction = np.array([np.cos(angle), np.sin(angle)])
    offset = z[0] * direction
    lever = np.array([-offset[1], offset[0]])
    Jr = np.column_stack([np.eye(2), lever])
    Jz = np.column_stack([direction, lever])
    new = slice(size, size + 2)
    state[new] = state[:2] + offset
    P[new, :size] = Jr @ P[:3, :size]
    P[:size, new] = P[new, :size].T
    P[new, new] = Jr @ P[:3, :3] @ Jr.T + Jz @ R @ Jz.T
