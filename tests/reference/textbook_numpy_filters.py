"""Dense and slow textbook versions of the filters that use numpy.

`textbook_riukf` uses the coordinates of the right-invariant error of robot and all landmarks, and changes states by exp
and log. Its sigma points are those of Brossard, Barrau and Bonnabel (ICRA 2020), for the landmarks relative to the
robot and then for the heading, which has no own pair. `textbook_robocentric_ekf` follows Castellanos et al. (2007) with
the state [world, landmarks, displacement]. All Jacobians are computed by differences.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import sqrtm

from slamgauge.arrays import Float, Int
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import rotation, wrap
from slamgauge.sensors import innovation, predict
from slamgauge.sensors import inverse as locate
from tests.reference.jacobians import differentiate
from tests.reference.textbook import additive_from_invariant, block_diagonal, exp_action, moved

Numbers = list[int]
SPREAD = 3.0**0.5  # sigmas from the mean to a sigma point


class TextbookInvariant:
    """State x (3 + 2L,) in the world frame, covariance P of xi with chi = exp(xi) chi^."""

    def __init__(self, recording: Recording) -> None:
        self.sensor = recording.sensor
        self.x = recording.prior_mean.copy()
        D = np.linalg.inv(additive_from_invariant(self.x))
        self.P = D @ recording.prior_cov @ D.T

    def predict(self, increment: Float, Q: Float) -> None:
        """Use sigma points of the noise in the order heading, x, y; only the first two points are not linear."""
        after, order = moved(self.x, increment), [2, 0, 1]
        columns = np.zeros((3, 3))
        columns[order] = semidefinite_factor(Q[np.ix_(order, order)])
        changes = [
            [invariant_error(moved(self.x, increment + sign * column), after) for sign in (SPREAD, -SPREAD)]
            for column in columns.T
        ]
        self.x = after
        for pair in changes:
            self.P = self.P + second_moment(np.array(pair))

    def correct(self, slots: Numbers, z: Float, R: Float) -> float:
        n, seen = len(self.x), sorted(set(slots))
        back = rotation(self.x[2]).T
        T = np.zeros((1 + 2 * len(seen), n))
        T[-1, 2] = 1.0
        for k, slot in enumerate(seen):
            T[2 * k : 2 * k + 2, :2], T[2 * k : 2 * k + 2, 3 + 2 * slot : 5 + 2 * slot] = -back, back
        U = T @ self.P @ T.T
        L = np.vstack([np.real(sqrtm(U[:-1, :-1])), np.zeros(len(U) - 1)])
        L[-1] = np.linalg.solve(L[:-1], U[:-1, -1])
        points = SPREAD * np.concatenate([L.T, -L.T])
        predicted = self.seen(self.x, slots)
        changes = np.zeros((len(points), 2 * len(slots)))
        for row, u in zip(changes, points, strict=True):
            xi = np.zeros(n)
            xi[2] = u[-1]
            for k, slot in enumerate(seen):
                xi[3 + 2 * slot : 5 + 2 * slot] = back.T @ u[2 * k : 2 * k + 2]
            values = self.seen(exp_action(xi, self.x), slots)
            row[:] = innovation(self.sensor, values, predicted).ravel()
        mean = changes.sum(axis=0) / (2.0 * SPREAD**2)
        S = second_moment(changes) - np.outer(mean, mean) + block_diagonal(R)
        H = (changes.T @ points / (2.0 * SPREAD**2)) @ np.linalg.pinv(U, rcond=1e-13, hermitian=True) @ T
        v = innovation(self.sensor, z, predicted + mean.reshape(-1, 2)).ravel()
        K = self.P @ H.T @ np.linalg.inv(S)
        self.P = self.P - K @ S @ K.T
        self.x = exp_action(K @ v, self.x)
        self.x[2] = wrap(self.x[2])
        return float(v @ np.linalg.inv(S) @ v)

    def seen(self, x: Float, slots: Numbers) -> Float:
        deltas = [rotation(x[2]).T @ (x[3 + 2 * slot : 5 + 2 * slot] - x[:2]) for slot in slots]
        return predict(self.sensor, np.array(deltas))

    def add(self, z: Float, R: Float) -> None:
        delta, turn, n = locate(self.sensor, z), rotation(self.x[2]), len(self.x)
        points = [z + sign * column for column in np.linalg.cholesky(R).T for sign in (SPREAD, -SPREAD)]
        noise = second_moment(np.array([turn @ (locate(self.sensor, each) - delta) for each in points]))
        T = np.vstack([np.eye(n), np.eye(2, n)])
        self.P = T @ self.P @ T.T
        self.P[n:, n:] += noise
        self.x = np.concatenate([self.x, self.x[:2] + turn @ delta])

    def in_world(self) -> tuple[Float, Float]:
        D = additive_from_invariant(self.x)
        return self.x, D @ self.P @ D.T


class TextbookRobocentric:
    """State [world (3), landmarks (2L), displacement (3)] in the body frame before the last movement.

    The origin of the world is the start position.
    """

    def __init__(self, recording: Recording) -> None:
        self.sensor = recording.sensor
        self.origin = recording.prior_mean[:2]
        start = np.array([0.0, 0.0, recording.prior_mean[2]])
        self.x = np.concatenate([inverse(start), np.zeros(3)])
        D = differentiate(inverse, start, angles=[2])
        self.P = np.zeros((6, 6))
        self.P[:3, :3] = D @ recording.prior_cov @ D.T

    def predict(self, increment: Float, Q: Float) -> None:
        self.transform(composed, angles=[2])
        self.x[-3:] = increment
        self.P[-3:, -3:] = Q

    def correct(self, slots: Numbers, z: Float, R: Float) -> float:
        def seen(x: Float) -> Float:
            deltas = [rotation(x[-1]).T @ (x[3 + 2 * slot : 5 + 2 * slot] - x[-3:-1]) for slot in slots]
            return predict(self.sensor, np.array(deltas)).ravel()

        bearings = [] if self.sensor == "position" else [*range(1, 2 * len(slots), 2)]
        H = differentiate(seen, self.x, angles=bearings)
        v = innovation(self.sensor, z, seen(self.x).reshape(-1, 2)).ravel()
        S = H @ self.P @ H.T + block_diagonal(R)
        K = self.P @ H.T @ np.linalg.inv(S)
        self.P = (np.eye(len(self.x)) - K @ H) @ self.P
        self.P = (self.P + self.P.T) / 2
        self.x = self.x + K @ v
        self.x[[2, -1]] = wrap(self.x[[2, -1]])
        self.transform(composed, angles=[2])
        return float(v @ np.linalg.inv(S) @ v)

    def add(self, z: Float, R: Float) -> None:
        self.transform(composed, angles=[2])
        B = differentiate(lambda at: locate(self.sensor, at), z)
        n = len(self.x) - 3
        T = np.insert(np.eye(n + 3), [n, n], 0.0, axis=0)
        self.P = T @ self.P @ T.T
        self.P[n : n + 2, n : n + 2] = B @ R @ B.T
        self.x = np.concatenate([self.x[:n], locate(self.sensor, z), np.zeros(3)])

    def transform(self, function: Callable[[Float], Float], angles: Numbers) -> None:
        F = differentiate(function, self.x, angles=angles)
        self.x, self.P = function(self.x), F @ self.P @ F.T

    def in_world(self) -> tuple[Float, Float]:
        F = differentiate(in_world, self.x, angles=[2])
        x = in_world(self.x)
        x[2] = wrap(x[2])
        x[:2] += self.origin
        x[3:] += np.tile(self.origin, len(x) // 2 - 1)
        return x, F @ self.P @ F.T


def textbook_riukf(recording: Recording) -> Estimate:
    return _run(TextbookInvariant(recording), recording)


def textbook_robocentric_ekf(recording: Recording) -> Estimate:
    return _run(TextbookRobocentric(recording), recording)


def _run(slam: TextbookInvariant | TextbookRobocentric, recording: Recording) -> Estimate:
    ids: Numbers = []
    poses, pose_covs, nis, dof = [], [], [], []
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            slam.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
        assert scan.landmark is not None
        names = scan.landmark.tolist()
        old = [i for i, name in enumerate(names) if name in ids]
        new = [i for i, name in enumerate(names) if name not in ids and name not in names[:i]]
        again = [i for i in range(len(names)) if i not in old + new]
        nis.append(slam.correct([ids.index(names[i]) for i in old], scan.value[old], scan.cov[old]) if old else 0.0)
        for i in new:
            slam.add(scan.value[i], scan.cov[i])
            ids.append(names[i])
        if again:
            nis[-1] += slam.correct([ids.index(names[i]) for i in again], scan.value[again], scan.cov[again])
        dof.append(2 * len(old + again))
        x, P = slam.in_world()
        poses.append(x[:3].copy())
        pose_covs.append((P[:3, :3] + P[:3, :3].T) / 2)
    x, P = slam.in_world()
    P = (P + P.T) / 2
    return Estimate(
        kind="filtered",
        poses=np.array(poses),
        pose_covs=np.array(pose_covs),
        landmark_ids=as_ids(ids),
        landmarks=x[3:].reshape(-1, 2),
        landmark_covs=np.array([P[i : i + 2, i : i + 2] for i in range(3, len(x), 2)]).reshape(-1, 2, 2),
        association=recording.landmark,
        nis=np.array(nis),
        nis_dof=np.array(dof),
    )


def as_ids(ids: Numbers) -> Int:
    return np.array(ids, dtype=np.int64)


def inverse(pose: Float) -> Float:
    """Return the inverse pose."""
    return np.append(-rotation(pose[2]).T @ pose[:2], wrap(-pose[2]))


def composed(x: Float) -> Float:
    """Return [world, landmarks, displacement] in the frame at the end of the displacement."""
    back, places = rotation(x[-1]).T, [x[:2], *x[3:-3].reshape(-1, 2)]
    there = [back @ (place - x[-3:-1]) for place in places]
    return np.concatenate([there[0], [wrap(x[2] - x[-1])], *there[1:], np.zeros(3)])


def in_world(x: Float) -> Float:
    """Return robot and landmarks in the world frame."""
    world = inverse(x[:3])
    places = [world[:2] + rotation(world[2]) @ place for place in [x[-3:-1], *x[3:-3].reshape(-1, 2)]]
    return np.concatenate([places[0], [world[2] + x[-1]], *places[1:]])


def invariant_error(x: Float, estimate: Float) -> Float:
    """Return xi such that exp(xi) acting on `estimate` gives x."""
    t = float(wrap(x[2] - estimate[2]))
    V = np.array([[np.sinc(t / np.pi), -t * half_versine(t)], [t * half_versine(t), np.sinc(t / np.pi)]])
    xi = np.zeros(len(x))
    xi[2] = t
    for i in (0, *range(3, len(x), 2)):
        xi[i : i + 2] = np.linalg.solve(V, x[i : i + 2] - rotation(t) @ estimate[i : i + 2])
    return xi


def half_versine(t: float) -> float:
    """Return (1 - cos t) / t^2."""
    return 0.5 * float(np.sinc(t / 2 / np.pi)) ** 2


def second_moment(changes: Float) -> Float:
    """Return the second moment of changes (2d, m), with Julier's alpha = SPREAD / sqrt(d), beta = 2, kappa = 0."""
    d = len(changes) / 2
    alpha = SPREAD / np.sqrt(d)
    scale = alpha**2 * d
    weight, mean_weight = 0.5 / scale, (scale - d) / scale
    center_weight = mean_weight + 1.0 - alpha**2 + 2.0
    mean = weight * changes.sum(axis=0)
    cov = center_weight * np.outer(mean, mean) + weight * (changes - mean).T @ (changes - mean)
    return cov + np.outer(mean, mean)


def semidefinite_factor(cov: Float) -> Float:
    """Return a lower triangular L with L L' = cov; its columns are zero where no variance is left."""
    rest, L = cov.copy(), np.zeros_like(cov)
    for k in range(len(cov)):
        if rest[k, k] > 1e-14 * cov[k, k]:
            L[k:, k] = rest[k:, k] / np.sqrt(rest[k, k])
            rest = rest - np.outer(L[:, k], L[:, k])
    return L
