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

Rows = tuple[Float, Float, Float]  # innovation (k,), H_1 (k, n), noise covariance (k, k)
ROUNDING = 1e-9  # singular values of whitened D up to this one are zero


def projected(recording: Recording) -> Estimate:
    return run(recording, project)


def inflated(recording: Recording) -> Estimate:
    return run(recording, inflate)


def project(v: Float, H: Float, D: Float, R: Float, _P: Float) -> Rows:
    whiten = np.linalg.inv(np.linalg.cholesky(R))
    U, size, _ = np.linalg.svd(whiten @ D)
    N = U[:, np.count_nonzero(size > ROUNDING) :].T @ whiten
    return N @ v, N @ H, N @ R @ N.T


def inflate(v: Float, H: Float, D: Float, R: Float, P: Float) -> Rows:
    return v, H, R + D @ P @ D.T


def run(recording: Recording, rows: Callable[[Float, Float, Float, Float, Float], Rows]) -> Estimate:
    if recording.landmark is None or recording.sensor == "bearing":
        raise ValueError("this filter needs landmark ids, and observations that place a landmark")
    belief, first = textbook.Belief(recording.prior_mean, recording.prior_cov, ()), recording.prior_mean
    poses, pose_covs = list[Float](), list[Float]()
    for step, scan in enumerate(recording.scans()):
        if step > 0:
            belief = shear(belief, belief.x[:2] - first[:2])
            belief = textbook.predict(belief, recording.odometry[step - 1], recording.odometry_cov[step - 1])
            first = np.concatenate([belief.x[:3], first[3:]])
        landmark = np.asarray(scan.landmark).tolist()
        mapped, new = (
            [i for i, each in enumerate(landmark) if (each in belief.ids) == known] for known in (True, False)
        )
        if mapped:
            slots = np.array([belief.ids.index(landmark[i]) for i in mapped])
            seen = recording.sensor, belief.x, slots, scan.value[mapped], scan.cov[mapped]
            v, H_now, R = textbook.stack(textbook.linearise(*seen), len(belief.x))
            _, H, _ = textbook.stack(textbook.linearise(*seen, x_jac=first), len(belief.x))
            belief, _, _ = textbook.update(belief, *rows(v, H, H_now - H, R, belief.P))
        lever = belief.x[:2] - first[:2]
        belief = shear(belief, lever)
        for i in new:
            belief = textbook.augment(recording.sensor, belief, landmark[i], scan.value[i], scan.cov[i])
        belief = shear(belief, -lever)
        first = np.concatenate([first, belief.x[len(first) :]])
        poses.append(belief.x[:3])
        pose_covs.append(belief.P[:3, :3])
    x, P, ids = belief
    blocks = P[3:, 3:].reshape(len(ids), 2, len(ids), 2)[np.arange(len(ids)), :, np.arange(len(ids))]
    return Estimate("filtered", np.array(poses), np.array(pose_covs), np.array(ids), x[3:].reshape(-1, 2), blocks)


def shear(belief: textbook.Belief, lever: Float) -> textbook.Belief:
    """Move the point about which a heading error turns the robot, by `lever` (2,) from the first estimate."""
    F = np.eye(len(belief.x))
    F[:2, 2] = textbook.J @ lever
    return belief._replace(P=F @ belief.P @ F.T)


if __name__ == "__main__":
    angle, radius = 0.15 + 2 * np.pi * np.arange(20) / 20, 10.0 - float(sys.argv[1])
    positions = np.column_stack([radius * np.sin(angle), 10.0 - radius * np.cos(angle)])
    lines = 'extends = "q1-long-dense"', "[landmarks]", f"positions = {positions.round(6).tolist()}"
    Path(sys.argv[2]).write_text("\n".join(lines) + "\n", encoding="utf-8")
