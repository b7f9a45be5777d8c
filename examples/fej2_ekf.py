"""FEJ2 in planar SLAM: first-estimates Jacobians that account for their own error, as an estimator in a file.

Idea: Chen, Yang, Geneva and Huang, "FEJ2: A Consistent Visual-Inertial State Estimator Design", ICRA 2022. H_1 is the
Jacobian at the first estimates, H_1 + D at the newest ones. For an error e, the innovation is v = (H_1 + D) e + n.

- `projected` uses N v = N H_1 e + N n only, with N the left null space of D.
- `inflated` updates with H_1 and the noise covariance R + D P D'. `projected` is its limit for a large P.

docs/consistency.md compares both with the built-in filters. Its scenario has landmarks at 0.1 m from the path:

    python examples/fej2_ekf.py 0.1 close.toml
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf import textbook
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import wrap

Rows = tuple[Float, Float, Float]  # H_1 (k, n), innovation (k,), noise covariance (k, k)
ROUNDING = 1e-9  # singular values of whitened D up to this one are zero


def projected(recording: Recording) -> Estimate:
    return run(recording, project)


def inflated(recording: Recording) -> Estimate:
    return run(recording, inflate)


def project(H: Float, D: Float, v: Float, R: Float, _P: Float) -> Rows:
    whiten = np.linalg.inv(np.linalg.cholesky(R))
    U, size, _ = np.linalg.svd(whiten @ D)
    N = U[:, np.count_nonzero(size > ROUNDING) :].T @ whiten
    return N @ H, N @ v, N @ R @ N.T


def inflate(H: Float, D: Float, v: Float, R: Float, P: Float) -> Rows:
    return H, v, R + D @ P @ D.T


def run(recording: Recording, rows: Callable[[Float, Float, Float, Float, Float], Rows]) -> Estimate:
    if recording.landmark is None or recording.sensor == "bearing":
        raise ValueError("this filter needs landmark ids, and observations that place a landmark")
    x, P, ids = recording.prior_mean, recording.prior_cov, list[int]()
    first = x  # predicted pose and first estimates of the landmarks
    poses, pose_covs = list[Float](), list[Float]()
    for step, scan in enumerate(recording.scans()):
        if step > 0:
            u, Q = recording.odometry[step - 1], recording.odometry_cov[step - 1]
            x, P = textbook.predict(x, shear(P, x[:2] - first[:2]), u, Q)  # the lever starts at the predicted position
            first = np.concatenate([x[:3], first[3:]])
        landmark = np.asarray(scan.landmark).tolist()
        mapped, new = ([i for i, each in enumerate(landmark) if (each in ids) == known] for known in (True, False))
        if mapped:
            slots = np.array([ids.index(landmark[i]) for i in mapped])
            now, then = (
                textbook.linearise(recording.sensor, at, slots, scan.value[mapped], scan.cov[mapped])
                for at in (x, first)
            )
            m, d = now.innovation.shape
            H_now, H, R = np.zeros((m, d, len(x))), np.zeros((m, d, len(x))), np.zeros((m, d, m, d))
            for i, columns in enumerate(now.columns):
                H_now[i][:, columns], H[i][:, columns], R[i, :, i] = now.jacobian[i], then.jacobian[i], now.noise[i]
            H_now, H, R = H_now.reshape(m * d, -1), H.reshape(m * d, -1), R.reshape(m * d, m * d)
            H, v, R = rows(H, H_now - H, now.innovation.ravel(), R, P)
            K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
            x, P = x + K @ v, P - K @ (H @ P)
            x[2] = wrap(x[2])
        for i in new:
            x, P = augment(recording.sensor, x, P, x[:2] - first[:2], scan.value[i], scan.cov[i])
            first = np.concatenate([first, x[-2:]])
            ids.append(landmark[i])
        poses.append(x[:3])
        pose_covs.append(P[:3, :3])
    blocks = P[3:, 3:].reshape(len(ids), 2, len(ids), 2)[np.arange(len(ids)), :, np.arange(len(ids))]
    return Estimate("filtered", np.array(poses), np.array(pose_covs), np.array(ids), x[3:].reshape(-1, 2), blocks)


def shear(P: Float, lever: Float) -> Float:
    F = np.eye(len(P))
    F[:2, 2] = textbook.J @ lever
    return F @ P @ F.T


def augment(sensor: str, x: Float, P: Float, lever: Float, z: Float, noise: Float) -> tuple[Float, Float]:
    landmark, J_r, J_z = textbook.locate(sensor, x[:3], z)
    J_r[:, 2] += textbook.J @ lever
    P_lx = J_r @ P[:3]
    P_ll = J_r @ P[:3, :3] @ J_r.T + J_z @ noise @ J_z.T
    return np.concatenate([x, landmark]), np.block([[P, P_lx.T], [P_lx, P_ll]])


if __name__ == "__main__":
    angle, radius = 0.15 + 2 * np.pi * np.arange(20) / 20, 10.0 - float(sys.argv[1])
    positions = np.column_stack([radius * np.sin(angle), 10.0 - radius * np.cos(angle)])
    lines = 'extends = "q1-long-dense"', "[landmarks]", f"positions = {positions.round(6).tolist()}"
    Path(sys.argv[2]).write_text("\n".join(lines) + "\n", encoding="utf-8")
