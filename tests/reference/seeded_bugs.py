"""A textbook EKF with an optional bug, and the check of `slamgauge check` that must fail for each bug.

The correct filter is that of the exercise, with the formulas of `slamgauge.ekf.textbook`, and takes one observation
after another. The line that a bug changes names the bug.
"""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf import textbook
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import between, compose, rotation

# each bug and the check that must fail, alone
SEEDED = {
    "wrong sign in F": "prediction-jacobian",
    "missing term in F": "prediction-jacobian",
    "Q in the wrong frame": "odometry-noise-frame",
    "sigma for variance in Q": "odometry-noise-size",
    "Q scaled by the time step": "time-step",
    "no heading in J of a new landmark": "first-sight",
    "no cross-covariance of a new landmark": "cross-covariance",
    "H of the range not divided by it": "update-range",
    "wrong sign in H of the bearing": "update-bearing",
    "wrong sign of y in H of the pose": "standing-robot",
    "R not added": "measurement-noise",
    "no wrap of the innovation": "innovation-wrap",
    "no wrap of the heading": "heading-wrap",
    "atan for atan2": "landmarks-behind",
    "motion along the heading after the turn": "truth-recovered",
    "stale landmark index": "scan-order",
    "ids taken for places": "permuted-ids",
    "landmarks forgotten": "long-unseen",
    "shifted by a step": "no-future",
    "start with no uncertainty": "prior-respected",
    "inverse of the prior": "zero-prior",
    "gain in single precision": "sound-covariances",
}


def predict(x: Float, P: Float, increment: Float, Q: Float, bug: str) -> tuple[Float, Float]:
    """Move the robot by an increment with covariance Q, both in the body frame."""
    F, G = textbook.motion_jacobians(x, increment)
    if bug == "wrong sign in F":
        F[0, 2] *= -1.0
    if bug == "missing term in F":
        F[1, 2] = 0.0
    if bug == "Q in the wrong frame":
        G = np.eye(3)
    if bug == "sigma for variance in Q":
        Q = np.sqrt(Q)
    x, P, direction, heading = x.copy(), P.copy(), x[2], x[2] + increment[2]
    if bug == "motion along the heading after the turn":
        direction = heading
    x[:2] += rotation(direction) @ increment[:2]
    x[2] = heading if bug == "no wrap of the heading" else wrap_once(heading)
    P[:3] = F @ P[:3]
    P[:, :3] = P[:, :3] @ F.T
    P[:3, :3] += G @ Q @ G.T
    return x, P


def update(x: Float, P: Float, number: int, z: Float, R: Float, bug: str) -> tuple[Float, Float]:
    """Correct with range and bearing of the landmark with this number."""
    seen = textbook.linearise("range-bearing", x, np.array([number]), z[None], R[None])
    rows, H = seen.jacobian[0], np.zeros((2, len(x)))
    dx, dy = x[3 + 2 * number : 5 + 2 * number] - x[:2]
    r = np.hypot(dx, dy)
    if bug == "H of the range not divided by it":
        rows[0] *= r
    if bug == "wrong sign in H of the bearing":
        rows[1, [0, 1, 3, 4]] *= -1.0
    if bug == "wrong sign of y in H of the pose":
        rows[0, 1] *= -1.0
    H[:, seen.columns[0]] = rows
    direction = np.arctan(dy / dx) if bug == "atan for atan2" else np.arctan2(dy, dx)
    v = z - [r, direction - x[2]]
    if bug != "no wrap of the innovation":
        v[1] = wrap_once(v[1])
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + (0.0 if bug == "R not added" else R))
    if bug == "gain in single precision":
        K = K.astype(np.float32).astype(np.float64)
    P = P - K @ H @ P
    return x + K @ v, (P + P.T) / 2


def add(x: Float, P: Float, z: Float, R: Float, bug: str) -> tuple[Float, Float]:
    """Append the landmark of a first observation."""
    position, J_r, J_y = textbook.locate("range-bearing", x[:3], z)
    if bug == "no heading in J of a new landmark":
        J_r[:, 2] = 0.0
    cross, own = J_r @ P[:3], J_r @ P[:3, :3] @ J_r.T + J_y @ R @ J_y.T
    if bug == "no cross-covariance of a new landmark":
        cross = np.zeros_like(cross)
    return np.append(x, position), np.block([[P, cross.T], [cross, own]])


def wrap_once(angle: float) -> float:
    """Return an angle between -3 pi and 3 pi wrapped to [-pi, pi]."""
    return angle - 2.0 * np.pi * np.sign(angle) if abs(angle) > np.pi else angle


def seeded_ekf(recording: Recording, bug: str = "") -> Estimate:
    """Run the textbook EKF with this bug, a key of `SEEDED`, or without a bug if empty."""
    x, P = recording.prior_mean, recording.prior_cov
    if bug == "inverse of the prior":
        P = np.asarray(np.linalg.inv(np.linalg.inv(P)), dtype=np.float64)
    if bug == "start with no uncertainty":
        P = np.zeros((3, 3))
    numbers, last_seen = dict[int, int](), dict[int, int]()  # their keys are ids
    poses, covs = list[Float](), list[Float]()
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            dt = recording.stamps[k] - recording.stamps[k - 1] if bug == "Q scaled by the time step" else 1.0
            x, P = predict(x, P, recording.odometry[k - 1], dt * recording.odometry_cov[k - 1], bug)
        assert scan.landmark is not None
        first = None
        for name, z, R in zip(scan.landmark.tolist(), scan.value, scan.cov, strict=True):
            is_forgotten = bug == "landmarks forgotten" and k - last_seen.get(name, k) > 20
            if name not in numbers or is_forgotten:
                numbers[name] = (len(x) - 3) // 2
                x, P = add(x, P, z, R, bug)
            else:
                number = name if bug == "ids taken for places" else numbers[name]
                if bug == "stale landmark index" and first is not None:
                    number = first
                x, P = update(x, P, number, z, R, bug)
            last_seen[name], first = k, numbers[name] if first is None else first
        poses.append(x[:3].copy())
        covs.append(P[:3, :3])
    if bug == "shifted by a step":
        back = between(recording.odometry, np.zeros(3))
        poses[:-1] = [compose(pose, step) for pose, step in zip(poses[1:], back, strict=True)]
    places = [slice(3 + 2 * number, 5 + 2 * number) for number in numbers.values()]
    positions = np.array([x[place] for place in places]).reshape(-1, 2)
    landmark_covs = np.array([P[place, place] for place in places]).reshape(-1, 2, 2)
    return Estimate("filtered", np.array(poses), np.array(covs), np.array([*numbers]), positions, landmark_covs)
