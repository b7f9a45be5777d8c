"""Dense and slow versions of the fast filters, used as references.

They share formulas with `slamgauge.ekf.textbook`, the EKF of the exercise. `_run` has these kinds:

* `standard`: the EKF, here with Student-t weights of the observations (`tails` degrees of freedom);
* `first-estimates`: Jacobians at the first position of each landmark and at the last predicted pose (Huang, Mourikis
  and Roumeliotis, IJRR 2010);
* `observable`: the unobservable directions N are propagated by F of the first-estimates filter, step by step, and every
  row of H, at the newest estimate, is projected so that H N = 0 (same paper);
* `iterated`: minimises the cost of the prior and the observations of one step (Bell and Cathey 1993), with another
  method than the fast filter;
* `invariant`: works in the coordinates of the right-invariant error (Barrau and Bonnabel, arXiv 1510.06263): F = I,
  noise on every landmark, updates by exp(K r), additive covariances at the end.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Literal

import numpy as np
import pytest
from scipy.linalg import block_diag

from slamgauge.arrays import Float
from slamgauge.ekf import ekf_slam, fej_ekf, iekf, oc_ekf, riekf, textbook, textbook_ekf
from slamgauge.ekf.kernels.belief import AT_POINT, Belief
from slamgauge.ekf.kernels.linearisation import PROJECTED
from slamgauge.ekf.textbook import J, Linearised
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import compose, mean_rotation, rotation, wrap

Kind = Literal["standard", "first-estimates", "observable", "iterated", "invariant"]
Jacobians = Literal["additive", "observable", "invariant"]
KEEP_FIRST = ("first-estimates", "observable")  # kinds with a separate linearisation point


def _run(recording: Recording, tails: float = math.inf, *, kind: Kind) -> Estimate:
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
        again = [
            i for i in range(len(names)) if i not in old + new
        ]  # further observations of a landmark that is new in this scan
        nis.append(0.0)
        dof.append(2 * len(old + again))
        for rows, then_new in ((old, new), (again, [])):
            slots, z, R = [ids.index(names[i]) for i in rows], scan.value[rows], scan.cov[rows]
            if tails < math.inf and rows:
                seen = linearised(recording.sensor, x, first if kind in KEEP_FIRST else x, slots, z, R, kind=jacobians)
                R = weighted(P, seen, tails)
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


student_t_ekf = partial(_run, kind="standard")
textbook_fej_ekf = partial(_run, kind="first-estimates")
textbook_oc_ekf = partial(_run, kind="observable")
textbook_iekf = partial(_run, kind="iterated")
textbook_riekf = partial(_run, kind="invariant")


def ekf_of_textbook(recording: Recording, tails: float | None = None) -> Estimate:
    """Run the textbook EKF, with `tails` the version that weighs observations."""
    return textbook_ekf(recording) if tails is None else student_t_ekf(recording, tails)


PAIRS = [  # filters of the fast family, each with its textbook version
    pytest.param(ekf_slam, ekf_of_textbook, id="ekf"),
    pytest.param(fej_ekf, textbook_fej_ekf, id="fej-ekf"),
    pytest.param(oc_ekf, textbook_oc_ekf, id="oc-ekf"),
    pytest.param(iekf, textbook_iekf, id="iekf"),
    pytest.param(riekf, textbook_riekf, id="riekf"),
]


def belief_of(x: Float, P: Float, point: Float | None = None, *, observable: bool = False) -> Belief:
    """State and covariance as the kernels take them; kernels change both in place."""
    form = PROJECTED if observable else AT_POINT
    return Belief(x, x if point is None else point, P, np.ones(len(x) // 2, dtype=np.bool_), len(x), form)


def additive_from_invariant(x: Float) -> Float:
    D = np.eye(len(x))
    D[:2, 2] = J @ x[:2]
    for i in range(3, len(x), 2):
        D[i : i + 2, 2] = J @ x[i : i + 2]
    return D


def moved(x: Float, increment: Float) -> Float:
    return np.concatenate([compose(x[:3], increment), x[3:]])


def predict_standard(x: Float, point: Float, P: Float, increment: Float, Q: Float) -> tuple[Float, Float]:
    after = moved(x, increment)
    F, G = np.eye(len(x)), np.zeros((len(x), 3))
    F[:2, 2] = J @ (after[:2] - point[:2])
    G[:3] = textbook.motion_jacobians(x, increment)[1]
    return after, F @ P @ F.T + G @ Q @ G.T


def predict_invariant(x: Float, _: Float, P: Float, increment: Float, Q: Float) -> tuple[Float, Float]:
    after = moved(x, increment)
    G = np.zeros((len(x), 3))
    G[:3] = textbook.motion_jacobians(x, increment)[1]
    G[:2, 2] = -J @ after[:2]
    for i in range(3, len(x), 2):
        G[i : i + 2, 2] = -J @ x[i : i + 2]
    return after, P + G @ Q @ G.T


def linearised(
    sensor: str, x: Float, point: Float, slots: list[int], z: Float, R: Float, *, kind: Jacobians = "additive"
) -> Linearised:
    """Return innovations at `x` and Jacobians at `point` (`observable`: at `x`, with H N = 0 at `point`)."""
    entries = np.array(slots, dtype=np.int64)
    seen = textbook.linearise(sensor, x, entries, z, R)
    at = x if kind == "observable" else point
    H = seen.jacobian if at is x else textbook.linearise(sensor, at, entries, z, R).jacobian
    if kind == "invariant":
        H[:, :, 2] = 0.0
    if kind == "observable":
        for a, columns in enumerate(seen.columns):
            N = unobservable(point)[columns]
            H[a] = H[a] @ (np.eye(5) - N @ np.linalg.solve(N.T @ N, N.T))
    return seen._replace(jacobian=H)


def dense(seen: Linearised, size: int) -> tuple[Float, Float]:
    """Return the innovation (2m,) and H (2m, n) of all observations."""
    H = np.zeros((*seen.innovation.shape, size))
    for i, columns in enumerate(seen.columns):
        H[i][:, columns] = seen.jacobian[i]
    return seen.innovation.ravel(), H.reshape(-1, size)


def block_diagonal(R: Float) -> Float:
    """Return the blocks (m, 2, 2) on the diagonal of a matrix (2m, 2m)."""
    return np.asarray(block_diag(*R))


def weighted(P: Float, seen: Linearised, tails: float) -> Float:
    """Return R / w of each observation, w = min(1, (n + 2) / (n + v' S^-1 v)) for n = `tails`."""
    weight = np.minimum(1.0, (tails + 2) / (tails + textbook.squared_distances(P, seen)))
    return seen.noise / weight[:, None, None]


def unobservable(point: Float) -> Float:
    """Return N (n, 3), translation and rotation of the whole map: [I, J p; 0, 1; I, J l]."""
    N = additive_from_invariant(point)[:, :3]
    for i in range(3, len(point), 2):
        N[i : i + 2, :2] = np.eye(2)
    return N


def update(
    sensor: str, x: Float, point: Float, P: Float, slots: list[int], z: Float, R: Float, *, kind: Jacobians
) -> tuple[Float, Float, float]:
    seen = linearised(sensor, x, point, slots, z, R, kind=kind)
    if kind != "invariant":
        return textbook.update(x, P, seen)[:3]
    xi, P, nis, _ = textbook.update(np.zeros(len(x)), P, seen)
    x = exp_action(xi, x)
    x[2] = wrap(x[2])
    return x, P, nis


def update_iterated(
    sensor: str, x: Float, P: Float, slots: list[int], z: Float, R: Float
) -> tuple[Float, Float, float]:
    """Minimise u'u + v' R^-1 v at x + Lu, P = LL', by Levenberg-Marquardt from u = 0."""

    def at(x: Float) -> tuple[Float, Float]:
        return dense(linearised(sensor, x, x, slots, z, R), len(x))

    variances, axes = np.linalg.eigh(P)
    L = axes * np.sqrt(variances.clip(min=0.0))
    root = np.linalg.inv(np.linalg.cholesky(block_diagonal(R)))

    def residuals(u: Float) -> tuple[Float, Float]:
        v, H = at(x + L @ u)
        return np.concatenate([u, root @ v]), np.vstack([np.eye(len(u)), -root @ H @ L])

    v, H = at(x)
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
    while True:  # Newton steps as long as they become shorter: the cost does not show the last digits
        r, A = residuals(u)
        bent = curvature(sensor, x + L @ u, slots, z, root.T @ r[len(u) :])
        step = -np.linalg.solve(A.T @ A - L.T @ bent @ L, A.T @ r)
        if not np.abs(step).max() < 0.5 * length:
            break
        u, length = u + step, np.abs(step).max()
    minimum = x + L @ u
    _, H = at(minimum)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + block_diagonal(R))
    P = (np.eye(len(x)) - K @ H) @ P
    minimum[2] = wrap(minimum[2])
    return minimum, (P + P.T) / 2, nis


def curvature(sensor: str, x: Float, slots: list[int], z: Float, weights: Float) -> Float:
    """Return the sum of weights_k d^2 h_k / dx^2 (n, n) by differences of H' weights per observation."""
    C, h, no_noise = np.zeros((len(x), len(x))), 1e-5, np.zeros((1, 2, 2))
    for a, slot in enumerate(slots):
        of_one = slice(2 * a, 2 * a + 2)
        for column in (0, 1, 2, 3 + 2 * slot, 4 + 2 * slot):
            ahead, behind = x.copy(), x.copy()
            ahead[column], behind[column] = x[column] + h, x[column] - h
            H = (dense(linearised(sensor, p, p, [slot], z[a : a + 1], no_noise), len(x))[1] for p in (ahead, behind))
            C[:, column] += np.subtract(*(each.T @ weights[of_one] for each in H)) / (2 * h)
    return (C + C.T) / 2


def exp_action(xi: Float, x: Float) -> Float:
    """Return exp(xi) acting from the left on robot and landmarks."""
    R, V = rotation(xi[2]), mean_rotation(xi[2])
    out = x.copy()
    out[:2] = R @ x[:2] + V @ xi[:2]
    out[2] = x[2] + xi[2]
    for i in range(3, len(x), 2):
        out[i : i + 2] = R @ x[i : i + 2] + V @ xi[i : i + 2]
    return out


def augment(
    sensor: str, x: Float, point: Float, P: Float, z: Float, R: Float, *, invariant: bool
) -> tuple[Float, Float]:
    landmark, J_r, J_y = textbook.locate(sensor, x[:3], z)
    J_r[:, 2] = 0.0 if invariant else J @ (landmark - point[:2])
    T = np.vstack([np.eye(len(x)), np.eye(2, len(x))])
    T[-2:, :3] = J_r
    P = T @ P @ T.T
    P[-2:, -2:] += J_y @ R @ J_y.T
    return np.concatenate([x, landmark]), P
