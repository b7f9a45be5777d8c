"""Textbook filters, dense and slow: the references that the project's filters are held against.

`textbook_ekf` is the practical's equations 1.1 on full matrices, with an explicit inverse.
`textbook_fej_ekf` keeps, beside the estimate, the point of its Jacobians: each landmark's first position and
the last predicted pose (Huang, Mourikis and Roumeliotis, IJRR 2010). `textbook_iekf` minimises
the cost of the prior and the observations of one step (Bell and Cathey 1993), by another method than ours.
`textbook_riekf` lives in the right-invariant error's own coordinates (Barrau and Bonnabel, arXiv
1510.06263): F = I, noise on every landmark, updates by exp(K r), additive covariances at the end.
`textbook_oc_ekf` propagates the unobservable directions N by the F of the first-estimates filter, step by step, and
projects every row of H, taken at the newest estimate, so that H N = 0 (Huang, Mourikis and Roumeliotis, IJRR 2010).
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf.kernels.belief import AT_POINT, Belief
from slamgauge.ekf.kernels.linearisation import PROJECTED
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import rotation, wrap

J = np.array([[0.0, -1.0], [1.0, 0.0]])
KEEP_FIRST = ("first-estimates", "observable")  # kinds of filters with a point of their own
Jacobians = Literal["additive", "observable", "invariant"]


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


def textbook_ekf(recording: Recording, tails: float = math.inf) -> Estimate:
    return _run(recording, "standard", tails)


def textbook_fej_ekf(recording: Recording, tails: float = math.inf) -> Estimate:
    return _run(recording, "first-estimates", tails)


def textbook_oc_ekf(recording: Recording, tails: float = math.inf) -> Estimate:
    return _run(recording, "observable", tails)


def textbook_iekf(recording: Recording, tails: float = math.inf) -> Estimate:
    return _run(recording, "iterated", tails)


def textbook_riekf(recording: Recording, tails: float = math.inf) -> Estimate:
    return _run(recording, "invariant", tails)


def _run(recording: Recording, kind: str, tails: float) -> Estimate:
    assert recording.landmark is not None
    invariant = kind == "invariant"
    jacobians: Jacobians = "invariant" if invariant else "observable" if kind == "observable" else "additive"
    x, P, ids = recording.prior_mean.copy(), recording.prior_cov.copy(), []
    first = x.copy()
    if invariant:
        D = additive_from_invariant(x)
        P = np.linalg.inv(D) @ P @ np.linalg.inv(D).T
    poses, pose_covs, nis, dof = [], [], [], []
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            predict = predict_invariant if invariant else predict_standard
            point = first if kind in KEEP_FIRST else x
            x, P = predict(x, point, P, recording.odometry[k - 1], recording.odometry_cov[k - 1])
            first[:3] = x[:3]
        assert scan.landmark is not None
        names = scan.landmark.tolist()
        old = [i for i, name in enumerate(names) if name in ids]
        new = [i for i, name in enumerate(names) if name not in ids and name not in names[:i]]
        again = [i for i in range(len(names)) if i not in old + new]  # of a landmark that is new in this scan
        nis.append(0.0)
        dof.append(2 * len(old + again))
        for rows, then_new in ((old, new), (again, [])):
            slots, z, R = [ids.index(names[i]) for i in rows], scan.value[rows], scan.cov[rows]
            if tails < math.inf and rows:
                R = weighed(recording.sensor, x, first if kind in KEEP_FIRST else x, P, slots, z, R, jacobians, tails)
            if rows and kind == "iterated":
                x, P, own = update_iterated(recording.sensor, x, P, slots, z, R)
                nis[-1] += own
            elif rows:
                point = first if kind in KEEP_FIRST else x
                x, P, own = update(recording.sensor, x, point, P, slots, z, R, kind=jacobians)
                nis[-1] += own
            for i in then_new:
                ids.append(names[i])
                point = first if kind in KEEP_FIRST else x
                x, P = augment(recording.sensor, x, point, P, scan.value[i], scan.cov[i], invariant=invariant)
                first = np.concatenate([first, x[-2:]])
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


def belief_of(x: Float, P: Float, point: Float | None = None, *, observable: bool = False) -> Belief:
    """What the kernels take for that state and covariance, which they change in place."""
    form = PROJECTED if observable else AT_POINT
    return Belief(x, x if point is None else point, P, np.ones(len(x) // 2, dtype=np.bool_), len(x), form)


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


def predict_standard(x: Float, point: Float, P: Float, increment: Float, Q: Float) -> tuple[Float, Float]:
    after = moved(x, increment)
    F, G = np.eye(len(x)), np.zeros((len(x), 3))
    F[:2, 2] = J @ (after[:2] - point[:2])
    G[:2, :2], G[2, 2] = rotation(x[2]), 1.0
    return after, F @ P @ F.T + G @ Q @ G.T


def predict_invariant(x: Float, _: Float, P: Float, increment: Float, Q: Float) -> tuple[Float, Float]:
    after = moved(x, increment)
    G = np.zeros((len(x), 3))
    G[:2, :2], G[2, 2] = rotation(x[2]), 1.0
    G[:2, 2] = -J @ after[:2]
    for i in range(3, len(x), 2):
        G[i : i + 2, 2] = -J @ x[i : i + 2]
    return after, P + G @ Q @ G.T


def linearised(
    sensor: str, x: Float, point: Float, slots: list[int], z: Float, *, kind: Jacobians = "additive"
) -> tuple[Float, Float]:
    """Innovation (2m,) at `x` and Jacobian H (2m, n) at `point`, or at `x` and with H N = 0 at `point`."""
    if kind == "observable":
        v, H = linearised(sensor, x, x, slots, z)
        for a, slot in enumerate(slots):
            columns = [0, 1, 2, 3 + 2 * slot, 4 + 2 * slot]
            N = unobservable(point)[columns]
            projection = np.eye(5) - N @ np.linalg.solve(N.T @ N, N.T)
            H[2 * a : 2 * a + 2, columns] = H[2 * a : 2 * a + 2, columns] @ projection
        return v, H
    H, v = np.zeros((2 * len(slots), len(x))), np.zeros(2 * len(slots))
    for a, slot in enumerate(slots):
        rows, cols = slice(2 * a, 2 * a + 2), slice(3 + 2 * slot, 5 + 2 * slot)
        offset = point[cols] - point[:2]
        B = observe(sensor, rotation(point[2]).T @ offset)[1] @ rotation(point[2]).T
        H[rows, :2], H[rows, cols] = -B, B
        if kind != "invariant":
            H[rows, 2] = -B @ J @ offset
        v[rows] = innovation(sensor, z[a], observe(sensor, rotation(x[2]).T @ (x[cols] - x[:2]))[0])
    return v, H


def weighed(
    sensor: str,
    x: Float,
    point: Float,
    P: Float,
    slots: list[int],
    z: Float,
    R: Float,
    kind: Jacobians,
    tails: float,
) -> Float:
    """R / w of each observation, w = min(1, (n + 2) / (n + v' S^-1 v)) for n = `tails`."""
    v, H = linearised(sensor, x, point, slots, z, kind=kind)
    heavier = R.copy()
    for a in range(len(slots)):
        rows = slice(2 * a, 2 * a + 2)
        distance = v[rows] @ np.linalg.inv(H[rows] @ P @ H[rows].T + R[a]) @ v[rows]
        heavier[a] /= min(1.0, (tails + 2) / (tails + distance))
    return heavier


def unobservable(point: Float) -> Float:
    """N (n, 3): shift and turn of the whole map, [I, J p; 0, 1; I, J l]."""
    N = additive_from_invariant(point)[:, :3]
    for i in range(3, len(point), 2):
        N[i : i + 2, :2] = np.eye(2)
    return N


def block_diagonal(R: Float) -> Float:
    noise = np.zeros((2 * len(R), 2 * len(R)))
    for a, block in enumerate(R):
        noise[2 * a : 2 * a + 2, 2 * a : 2 * a + 2] = block
    return noise


def update(
    sensor: str, x: Float, point: Float, P: Float, slots: list[int], z: Float, R: Float, *, kind: Jacobians
) -> tuple[Float, Float, float]:
    v, H = linearised(sensor, x, point, slots, z, kind=kind)
    S = H @ P @ H.T + block_diagonal(R)
    K = P @ H.T @ np.linalg.inv(S)
    P = (np.eye(len(x)) - K @ H) @ P
    P = (P + P.T) / 2
    x = exp_action(K @ v, x) if kind == "invariant" else x + K @ v
    x[2] = wrap(x[2])
    return x, P, float(v @ np.linalg.inv(S) @ v)


def update_iterated(
    sensor: str, x: Float, P: Float, slots: list[int], z: Float, R: Float
) -> tuple[Float, Float, float]:
    """The least of u'u + v' R^-1 v at x + Lu, P = LL', by Levenberg-Marquardt from u = 0; Jacobians are those there."""
    variances, axes = np.linalg.eigh(P)
    L = axes * np.sqrt(variances.clip(min=0.0))
    root = np.linalg.inv(np.linalg.cholesky(block_diagonal(R)))

    def residuals(u: Float) -> tuple[Float, Float]:
        v, H = linearised(sensor, x + L @ u, x + L @ u, slots, z)
        return np.concatenate([u, root @ v]), np.vstack([np.eye(len(u)), -root @ H @ L])

    v, H = linearised(sensor, x, x, slots, z)
    nis = float(v @ np.linalg.solve(H @ P @ H.T + block_diagonal(R), v))
    u, damping = np.zeros(len(x)), 0.0
    for _ in range(1000):
        r, A = residuals(u)
        step = -np.linalg.solve(A.T @ A + damping * np.eye(len(u)), A.T @ r)
        if np.abs(step).max() < 1e-7:
            break
        if np.sum(residuals(u + step)[0] ** 2) <= np.sum(r**2) * (1.0 + 1e-15):
            u, damping = u + step, damping / 10.0 if damping > 1e-6 else 0.0
        else:
            damping = max(10.0 * damping, 1e-3)
    length = np.inf
    while True:  # the last digits, of which the cost tells nothing: Newton's steps, as long as they become shorter
        r, A = residuals(u)
        bent = curvature(sensor, x + L @ u, slots, z, root.T @ r[len(u) :])
        step = -np.linalg.solve(A.T @ A - L.T @ bent @ L, A.T @ r)
        if not np.abs(step).max() < 0.5 * length:
            break
        u, length = u + step, np.abs(step).max()
    minimum = x + L @ u
    _, H = linearised(sensor, minimum, minimum, slots, z)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + block_diagonal(R))
    P = (np.eye(len(x)) - K @ H) @ P
    minimum[2] = wrap(minimum[2])
    return minimum, (P + P.T) / 2, nis


def curvature(sensor: str, x: Float, slots: list[int], z: Float, weights: Float) -> Float:
    """Sum of weights_k d^2 h_k / dx^2 (n, n), by differences of H' weights, observation by observation."""
    C, h = np.zeros((len(x), len(x))), 1e-5
    for a, slot in enumerate(slots):
        of_one = slice(2 * a, 2 * a + 2)
        for column in (0, 1, 2, 3 + 2 * slot, 4 + 2 * slot):
            ahead, behind = x.copy(), x.copy()
            ahead[column], behind[column] = x[column] + h, x[column] - h
            H = (linearised(sensor, p, p, [slot], z[a : a + 1])[1] for p in (ahead, behind))
            C[:, column] += np.subtract(*(each.T @ weights[of_one] for each in H)) / (2 * h)
    return (C + C.T) / 2


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


def augment(
    sensor: str, x: Float, point: Float, P: Float, z: Float, R: Float, *, invariant: bool
) -> tuple[Float, Float]:
    delta, Jz = locate(sensor, z)
    Jz = rotation(x[2]) @ Jz
    offset = rotation(x[2]) @ delta
    Jr = np.zeros((2, len(x)))
    Jr[:, :2] = np.eye(2)
    if not invariant:
        Jr[:, 2] = J @ (x[:2] + offset - point[:2])
    T = np.vstack([np.eye(len(x)), Jr])
    P = T @ P @ T.T
    P[-2:, -2:] += Jz @ R @ Jz.T
    return np.concatenate([x, x[:2] + offset]), P
