"""Textbook filters, dense and slow: the references that the project's filters are held against.

`textbook_ekf` is the practical's equations 1.1 on full matrices, with an explicit inverse.
`textbook_riekf` lives in the right-invariant error's own coordinates (Barrau and Bonnabel, arXiv
1510.06263): F = I, noise on every landmark, updates by exp(K r), additive covariances at the end.
"""

from __future__ import annotations

import numpy as np

from slam2d import Estimate, Float, Recording, rotation, wrap

J = np.array([[0.0, -1.0], [1.0, 0.0]])


def observe(sensor: str, delta: Float) -> tuple[Float, Float]:
    """Prediction and its Jacobian for a landmark at `delta` in the body frame."""
    if sensor == "position":
        return delta, np.eye(2)
    rho = float(np.hypot(*delta))
    return np.array([rho, np.arctan2(delta[1], delta[0])]), np.vstack([delta / rho, J @ delta / rho**2])


def innovation(sensor: str, z: Float, predicted: Float) -> Float:
    difference = z - predicted
    if sensor == "range-bearing":
        difference[1] = wrap(difference[1])
    return difference


def locate(sensor: str, z: Float) -> tuple[Float, Float]:
    """The landmark in the body frame for a sight `z`, and its Jacobian."""
    if sensor == "position":
        return z, np.eye(2)
    r, b = z
    return r * np.array([np.cos(b), np.sin(b)]), np.array([[np.cos(b), -r * np.sin(b)], [np.sin(b), r * np.cos(b)]])


def textbook_ekf(recording: Recording) -> Estimate:
    return _run(recording, invariant=False)


def textbook_riekf(recording: Recording) -> Estimate:
    return _run(recording, invariant=True)


def _run(recording: Recording, *, invariant: bool) -> Estimate:
    assert recording.landmark is not None
    x, P, ids = recording.prior_mean.copy(), recording.prior_cov.copy(), []
    if invariant:
        D = additive_from_invariant(x)
        P = np.linalg.inv(D) @ P @ np.linalg.inv(D).T
    poses, pose_covs, nis, dof = [], [], [], []
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            predict = predict_invariant if invariant else predict_standard
            x, P = predict(x, P, recording.odometry[k - 1], recording.odometry_cov[k - 1])
        assert scan.landmark is not None
        old = [i for i, name in enumerate(scan.landmark) if name in ids]
        nis.append(0.0)
        dof.append(2 * len(old))
        if old:
            slots = [ids.index(scan.landmark[i]) for i in old]
            x, P, nis[-1] = update(recording.sensor, x, P, slots, scan.value[old], scan.cov[old], invariant=invariant)
        for i, name in enumerate(scan.landmark):
            if name not in ids:
                ids.append(name)
                x, P = augment(recording.sensor, x, P, scan.value[i], scan.cov[i], invariant=invariant)
        D = additive_from_invariant(x) if invariant else np.eye(len(x))
        poses.append(x[:3])
        pose_covs.append((D @ P @ D.T)[:3, :3])
    D = additive_from_invariant(x) if invariant else np.eye(len(x))
    full = D @ P @ D.T
    return Estimate(
        kind="filtered",
        poses=np.array(poses),
        pose_covs=np.array(pose_covs),
        landmark_ids=np.array(ids, dtype=np.int64),
        landmarks=x[3:].reshape(-1, 2),
        landmark_covs=np.array([full[i : i + 2, i : i + 2] for i in range(3, len(x), 2)]).reshape(-1, 2, 2),
        association=recording.landmark,
        nis=np.array(nis),
        nis_dof=np.array(dof),
    )


def additive_from_invariant(x: Float) -> Float:
    D = np.eye(len(x))
    D[:2, 2] = J @ x[:2]
    for i in range(3, len(x), 2):
        D[i : i + 2, 2] = J @ x[i : i + 2]
    return D


def moved(x: Float, increment: Float) -> Float:
    x = x.copy()
    x[:2] += rotation(x[2]) @ increment[:2]
    x[2] = wrap(x[2] + increment[2])
    return x


def predict_standard(x: Float, P: Float, increment: Float, Q: Float) -> tuple[Float, Float]:
    after = moved(x, increment)
    F, G = np.eye(len(x)), np.zeros((len(x), 3))
    F[:2, 2] = J @ (after[:2] - x[:2])
    G[:2, :2], G[2, 2] = rotation(x[2]), 1.0
    return after, F @ P @ F.T + G @ Q @ G.T


def predict_invariant(x: Float, P: Float, increment: Float, Q: Float) -> tuple[Float, Float]:
    after = moved(x, increment)
    G = np.zeros((len(x), 3))
    G[:2, :2], G[2, 2] = rotation(x[2]), 1.0
    G[:2, 2] = -J @ after[:2]
    for i in range(3, len(x), 2):
        G[i : i + 2, 2] = -J @ x[i : i + 2]
    return after, P + G @ Q @ G.T


def update(
    sensor: str, x: Float, P: Float, slots: list[int], z: Float, R: Float, *, invariant: bool
) -> tuple[Float, Float, float]:
    m = len(slots)
    H, v, noise = np.zeros((2 * m, len(x))), np.zeros(2 * m), np.zeros((2 * m, 2 * m))
    for a, slot in enumerate(slots):
        rows, cols = slice(2 * a, 2 * a + 2), slice(3 + 2 * slot, 5 + 2 * slot)
        offset = x[cols] - x[:2]
        predicted, A = observe(sensor, rotation(x[2]).T @ offset)
        B = A @ rotation(x[2]).T
        H[rows, :2], H[rows, cols] = -B, B
        if not invariant:
            H[rows, 2] = -B @ J @ offset
        v[rows] = innovation(sensor, z[a], predicted)
        noise[rows, rows] = R[a]
    S = H @ P @ H.T + noise
    K = P @ H.T @ np.linalg.inv(S)
    P = (np.eye(len(x)) - K @ H) @ P
    P = (P + P.T) / 2
    x = exp_action(K @ v, x) if invariant else x + K @ v
    x[2] = wrap(x[2])
    return x, P, float(v @ np.linalg.inv(S) @ v)


def exp_action(xi: Float, x: Float) -> Float:
    """exp(xi) acting from the left on robot and landmarks."""
    t = xi[2]
    V = np.eye(2) if t == 0 else np.array([[np.sin(t), np.cos(t) - 1], [1 - np.cos(t), np.sin(t)]]) / t
    out = x.copy()
    out[:2] = rotation(t) @ x[:2] + V @ xi[:2]
    out[2] = x[2] + t
    for i in range(3, len(x), 2):
        out[i : i + 2] = rotation(t) @ x[i : i + 2] + V @ xi[i : i + 2]
    return out


def augment(sensor: str, x: Float, P: Float, z: Float, R: Float, *, invariant: bool) -> tuple[Float, Float]:
    delta, Jz = locate(sensor, z)
    Jz = rotation(x[2]) @ Jz
    offset = rotation(x[2]) @ delta
    Jr = np.zeros((2, len(x)))
    Jr[:, :2] = np.eye(2)
    if not invariant:
        Jr[:, 2] = J @ offset
    T = np.vstack([np.eye(len(x)), Jr])
    P = T @ P @ T.T
    P[-2:, -2:] += Jz @ R @ Jz.T
    return np.concatenate([x, x[:2] + offset]), P
