"""A landmark filter written by a user, compared with the optimum.

It corrects with one observation at a time and neglects the correlation between robot and landmarks. This is easy to
write and makes the filter overconfident: see its NEES. Run it from this folder on q1-long-dense,

    python own_estimator.py

or on a stored recording next to the built-in filters:

    slamgauge run q1-long-dense --out first-run
    slamgauge evaluate first-run/recording.npz --estimators ekf,causal,own_estimator.py:estimate
"""

from __future__ import annotations

import numpy as np

from slamgauge import compare_estimators, load_estimators, load_scenario, simulate
from slamgauge.arrays import Float
from slamgauge.compare.scoring.comparison import table
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import compose, rotation, wrap


def estimate(recording: Recording) -> Estimate:
    if recording.landmark is None or recording.sensor != "range-bearing":
        raise ValueError("this filter needs known association, ranges and bearings")
    pose, P = recording.prior_mean, recording.prior_cov
    landmarks: dict[int, Float] = {}
    landmark_covs: dict[int, Float] = {}
    poses, pose_covs = np.empty((recording.steps + 1, 3)), np.empty((recording.steps + 1, 3, 3))

    for k in range(recording.steps + 1):
        if k > 0:
            pose, P = predict(pose, P, recording.odometry[k - 1], recording.odometry_cov[k - 1])
        for i in np.flatnonzero(recording.observation_step == k):
            name, z, R = int(recording.landmark[i]), recording.observation[i], recording.observation_cov[i]
            if name not in landmarks:
                delta = z[0] * np.array([np.cos(pose[2] + z[1]), np.sin(pose[2] + z[1])])
                landmarks[name] = pose[:2] + delta
                H_pose, H_landmark = jacobians(delta)
                into_world = np.linalg.inv(H_landmark)
                landmark_covs[name] = into_world @ (H_pose @ P @ H_pose.T + R) @ into_world.T
                continue
            delta = landmarks[name] - pose[:2]
            H_pose, H_landmark = jacobians(delta)
            innovation = z - [np.hypot(*delta), np.arctan2(delta[1], delta[0]) - pose[2]]
            innovation[1] = wrap(innovation[1])
            P_landmark = landmark_covs[name]
            S = H_pose @ P @ H_pose.T + H_landmark @ P_landmark @ H_landmark.T + R
            gain, landmark_gain = P @ H_pose.T @ np.linalg.inv(S), P_landmark @ H_landmark.T @ np.linalg.inv(S)
            pose, P = pose + gain @ innovation, P - gain @ S @ gain.T
            landmarks[name] = landmarks[name] + landmark_gain @ innovation
            landmark_covs[name] = P_landmark - landmark_gain @ S @ landmark_gain.T
        poses[k], pose_covs[k] = pose, P

    ids, covs = np.array(list(landmarks), dtype=np.int64), np.reshape(list(landmark_covs.values()), (-1, 2, 2))
    return Estimate("filtered", poses, pose_covs, ids, np.reshape(list(landmarks.values()), (-1, 2)), covs)


def predict(pose: Float, P: Float, increment: Float, increment_cov: Float) -> tuple[Float, Float]:
    F, B = np.eye(3), np.eye(3)
    B[:2, :2] = rotation(pose[2])
    F[:2, 2] = B[:2, :2] @ [-increment[1], increment[0]]
    return compose(pose, increment), F @ P @ F.T + B @ increment_cov @ B.T


def jacobians(delta: Float) -> tuple[Float, Float]:
    (dx, dy), r = delta, np.hypot(*delta)
    H_landmark = np.array([[dx / r, dy / r], [-dy / r**2, dx / r**2]])
    return np.column_stack([-H_landmark, [0, -1]]), H_landmark


def main() -> None:
    truth, recording = simulate(load_scenario("q1-long-dense"), seed=0)
    print(table(compare_estimators(truth, recording, {"own": estimate, **load_estimators(["causal", "batch"])})))


if __name__ == "__main__":
    main()
