"""Dense and slow versions of the fast filters, used as references.

They share formulas with `slamgauge.ekf.textbook`, the EKF of the exercise. `DenseFilter` has these kinds:

* `standard`: the EKF, here with Student-t weights of the observations (`tails` degrees of freedom);
* `first-estimates`: Jacobians at the first position of each landmark and at the last predicted pose (Huang, Mourikis
  and Roumeliotis, IJRR 2010);
* `observable`: the unobservable directions N are propagated by F of the first-estimates filter, step by step, and every
  row of H, at the newest estimate, is projected so that H N = 0 (same paper);
* `iterated`: minimises the cost of the prior and the observations of one step (Bell and Cathey 1993) with MINPACK;
* `invariant`: works in the coordinates of the right-invariant error (Barrau and Bonnabel, arXiv 1510.06263): F = I,
  noise on every landmark, updates by exp(K r), additive covariances at the end.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import least_squares

from slamgauge.arrays import Float, Int
from slamgauge.ekf import Association, ekf_slam, fej_ekf, iekf, oc_ekf, riekf, textbook, textbook_ekf
from slamgauge.ekf.kernels.belief import AT_POINT, Belief
from slamgauge.ekf.kernels.linearisation import PROJECTED
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.map_state import NewEntries
from slamgauge.ekf.textbook import J, Linearised
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import compose, exp, rotation, wrap
from tests.reference.jacobians import differentiate

Kind = Literal["standard", "first-estimates", "observable", "iterated", "invariant"]
Step = tuple[Float, Float, float, int]  # pose, its additive covariance, NIS, degrees of freedom


class DenseFilter:
    """A filter on full matrices; landmarks are numbered in the order of their addition.

    Attributes:
        x: (3 + 2L,) mean.
        P: (3 + 2L, 3 + 2L) covariance of the filter's error: right-invariant for `invariant`, else additive.
        first: (3 + 2L,) the last predicted pose, and the first position of each landmark.
    """

    def __init__(self, sensor: str, x: Float, P: Float, kind: Kind, tails: float = math.inf) -> None:
        """Start at x with the additive covariance P."""
        self.sensor, self.kind, self.tails = sensor, kind, tails
        self.x, self.first = x.copy(), x.copy()
        self.cov = P

    @property
    def cov(self) -> Float:
        """(3 + 2L, 3 + 2L) covariance of the additive error."""
        D = self.to_additive()
        cov = D @ self.P @ D.T
        return (cov + cov.T) / 2

    @cov.setter
    def cov(self, cov: Float) -> None:
        back = np.linalg.inv(self.to_additive())
        self.P = back @ cov @ back.T

    def to_additive(self) -> Float:
        """Return D, the additive error for an error of the filter, to first order."""
        return additive_from_invariant(self.x) if self.kind == "invariant" else np.eye(len(self.x))

    @property
    def landmark_count(self) -> int:
        """L."""
        return (len(self.x) - 3) // 2

    @property
    def point(self) -> Float:
        """(3 + 2L,) where Jacobians of motion and of new landmarks are taken."""
        return self.first if self.kind in ("first-estimates", "observable") else self.x

    def predict(self, increment: Float, Q: Float) -> None:
        x = np.concatenate([compose(self.x[:3], increment), self.x[3:]])
        F, G = np.eye(len(x)), np.zeros((len(x), 3))
        G[:3] = textbook.motion_jacobians(self.x, increment)[1]
        if self.kind == "invariant":
            G[:2, 2] = -J @ x[:2]
            for i in range(3, len(x), 2):
                G[i : i + 2, 2] = -J @ x[i : i + 2]
        else:
            F[:2, 2] = J @ (x[:2] - self.point[:2])
        self.x, self.P = x, F @ self.P @ F.T + G @ Q @ G.T
        self.first[:3] = x[:3]

    def linearise(self, slots: list[int], z: Float, R: Float) -> Linearised:
        """Compare observations (m, 2), with covariances (m, 2, 2), with predictions for the landmarks `slots`."""
        x_jac = self.first if self.kind == "first-estimates" else self.x
        seen = textbook.linearise(self.sensor, self.x, np.array(slots, dtype=np.int64), z, R, x_jac)
        if self.kind == "invariant":
            seen.jacobian[:, :, 2] = 0.0
        if self.kind == "observable":
            for H, columns in zip(seen.jacobian, seen.columns, strict=True):
                N = unobservable(self.first)[columns]
                H[:] = H @ (np.eye(5) - N @ np.linalg.solve(N.T @ N, N.T))
        return seen

    def squared_distances(self, z: Float, R: Float) -> Float:
        """Return d^2 (L,) of one observation and every landmark."""
        copies = np.tile(z, (self.landmark_count, 1)), np.tile(R, (self.landmark_count, 1, 1))
        return textbook.squared_distances(self.P, self.linearise([*range(self.landmark_count)], *copies))

    def update(self, slots: list[int], z: Float, R: Float) -> float:
        """Update with observations (m, 2), with covariances (m, 2, 2), of the landmarks `slots`; return the NIS."""
        if not slots:
            return 0.0
        seen = self.linearise(slots, z, R)
        if self.tails < math.inf:
            seen = seen._replace(noise=weighted(self.P, seen, self.tails))
        if self.kind == "iterated":
            self.x, self.P, nis = update_iterated(self.sensor, self.x, self.P, slots, z, seen.noise)
            return nis
        at = np.zeros(len(self.x)) if self.kind == "invariant" else self.x
        (x, self.P, _), nis, _ = textbook.update(textbook.Belief(at, self.P, ()), *textbook.stack(seen, len(at)))
        self.x = exp_action(x, self.x) if self.kind == "invariant" else x
        self.x[2] = wrap(self.x[2])
        return nis

    def augment(self, z: Float, R: Float) -> None:
        """Append a new landmark, observed at z (2,)."""
        landmark, J_r, J_y = textbook.locate(self.sensor, self.x[:3], z)
        J_r[:, 2] = 0.0 if self.kind == "invariant" else J @ (landmark - self.point[:2])
        T = np.vstack([np.eye(len(self.x)), np.eye(2, len(self.x))])
        T[-2:, :3] = J_r
        self.P = T @ self.P @ T.T
        self.P[-2:, -2:] += J_y @ R @ J_y.T
        self.x, self.first = np.concatenate([self.x, landmark]), np.concatenate([self.first, landmark])


def _run(recording: Recording, tails: float = math.inf, *, kind: Kind) -> Estimate:
    assert recording.landmark is not None
    slam = DenseFilter(recording.sensor, recording.prior_mean, recording.prior_cov, kind, tails)
    ids, steps = list[int](), list[Step]()
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            slam.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
        assert scan.landmark is not None
        names = scan.landmark.tolist()
        old = [i for i, name in enumerate(names) if name in ids]
        new = [i for i, name in enumerate(names) if name not in ids and name not in names[:i]]
        again = [i for i in range(len(names)) if i not in old + new]  # further observations of a new landmark
        nis = slam.update([ids.index(names[i]) for i in old], scan.value[old], scan.cov[old])
        for i in new:
            ids.append(names[i])
            slam.augment(scan.value[i], scan.cov[i])
        nis += slam.update([ids.index(names[i]) for i in again], scan.value[again], scan.cov[again])
        steps.append((slam.x[:3], slam.cov[:3, :3], nis, 2 * len(old + again)))
    return estimate_of(slam, np.array(ids, dtype=np.int64), steps, recording.landmark)


def textbook_nearest_neighbour(recording: Recording, gate: float, kind: Kind) -> Estimate:
    """Run a filter with nearest-neighbour association; landmark ids are 0, 1, ... in the order of their addition."""
    if kind == "standard":
        return textbook_ekf(replace(recording, landmark=None), Association(gate=gate))
    slam = DenseFilter(recording.sensor, recording.prior_mean, recording.prior_cov, kind)
    association, steps = list[int](), list[Step]()
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            slam.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
        nis, dof = 0.0, 0
        for z, R in zip(scan.value, scan.cov, strict=True):
            distances = slam.squared_distances(z, R)
            if distances.min(initial=np.inf) <= gate:
                slot = int(np.argmin(distances))
                nis, dof = nis + slam.update([slot], z[None], R[None]), dof + 2
            else:
                slot = slam.landmark_count
                slam.augment(z, R)
            association.append(slot)
        steps.append((slam.x[:3], slam.cov[:3, :3], nis, dof))
    return estimate_of(slam, np.arange(slam.landmark_count), steps, np.array(association, dtype=np.int64))


def estimate_of(slam: DenseFilter, ids: Int, steps: list[Step], association: Int) -> Estimate:
    """Return the estimate of a run; `ids` (L,) are the landmarks, `association` (M,) those of the observations."""
    poses, pose_covs, nis, dof = (np.array(each) for each in zip(*steps, strict=True))
    cov = slam.cov
    return Estimate(
        kind="filtered",
        poses=poses,
        pose_covs=pose_covs,
        landmark_ids=ids,
        landmarks=slam.x[3:].reshape(-1, 2),
        landmark_covs=np.array([cov[i : i + 2, i : i + 2] for i in range(3, len(cov), 2)]).reshape(-1, 2, 2),
        association=association,
        nis=nis,
        nis_dof=dof,
    )


def ekf_of_textbook(recording: Recording, tails: float | None = None) -> Estimate:
    """Run the textbook EKF, with `tails` the version that weighs observations."""
    return textbook_ekf(recording) if tails is None else _run(recording, tails, kind="standard")


PAIRS: dict[str, tuple[Callable[..., Estimate], Callable[..., Estimate]]] = {  # filters and their textbook forms
    "ekf": (ekf_slam, ekf_of_textbook),
    "fej-ekf": (fej_ekf, partial(_run, kind="first-estimates")),
    "oc-ekf": (oc_ekf, partial(_run, kind="observable")),
    "iekf": (iekf, partial(_run, kind="iterated")),
    "riekf": (riekf, partial(_run, kind="invariant")),
}


def belief_of(x: Float, P: Float, point: Float | None = None, *, observable: bool = False) -> Belief:
    """State and covariance as the kernels take them; kernels change both in place."""
    form = PROJECTED if observable else AT_POINT
    return Belief(x, x if point is None else point, P, np.ones(len(x) // 2, dtype=np.bool_), len(x), form)


def fill_map(landmarks: LandmarkMap, ids: Int, positions: Float, cov: Float) -> None:
    """Give an empty map landmarks (L,) at positions (L, 2) [m] in the world frame, and the covariance (n, n) of all."""
    values, nothing = np.ravel(positions - landmarks.origin), np.zeros(0, dtype=np.int64)
    is_point = [True] * len(ids)
    landmarks.add_entries(ids, NewEntries(values, nothing, np.zeros((len(values), 0)), cov[3:, 3:], is_point))
    landmarks.belief.cov[: len(cov), : len(cov)] = cov


def additive_from_invariant(x: Float) -> Float:
    D = np.eye(len(x))
    D[:2, 2] = J @ x[:2]
    for i in range(3, len(x), 2):
        D[i : i + 2, 2] = J @ x[i : i + 2]
    return D


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


def update_iterated(
    sensor: str, x: Float, P: Float, slots: list[int], z: Float, R: Float
) -> tuple[Float, Float, float]:
    """Minimise u'u + v' R^-1 v at x + Lu, P = LL', with MINPACK from u = 0."""

    def at(x: Float) -> tuple[Float, Float]:
        return textbook.stack(textbook.linearise(sensor, x, np.array(slots), z, R), len(x))[:2]

    variances, axes = np.linalg.eigh(P)
    L = axes * np.sqrt(variances.clip(min=0.0))
    root = np.linalg.inv(np.linalg.cholesky(block_diagonal(R)))

    def residuals(u: Float) -> Float:
        return np.concatenate([u, root @ at(x + L @ u)[0]])

    def jacobian(u: Float) -> Float:
        return np.vstack([np.eye(len(u)), -root @ at(x + L @ u)[1] @ L])

    v, H = at(x)
    nis = float(v @ np.linalg.solve(H @ P @ H.T + block_diagonal(R), v))
    start = np.zeros(len(x))
    u, length = least_squares(residuals, start, jacobian, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15).x, np.inf
    while True:  # Gauss-Newton steps as long as they become shorter: the cost does not show the last digits
        step = np.linalg.lstsq(jacobian(u), -residuals(u))[0]
        if not np.abs(step).max() < 0.9 * length:
            break
        u, length = u + step, np.abs(step).max()
    for _ in range(3 if np.abs(step).max() > 1e-11 else 0):  # Gauss-Newton swings where residuals are large
        hessian = differentiate(lambda at: jacobian(at).T @ residuals(at), u)
        u = u - np.linalg.solve(hessian, jacobian(u).T @ residuals(u))
    minimum = x + L @ u
    _, H = at(minimum)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + block_diagonal(R))
    P = (np.eye(len(x)) - K @ H) @ P
    minimum[2] = wrap(minimum[2])
    return minimum, (P + P.T) / 2, nis


def exp_action(xi: Float, x: Float) -> Float:
    """Return exp(xi) acting from the left on robot and landmarks."""
    R = rotation(xi[2])
    V = np.column_stack([exp([1.0, 0.0, xi[2]])[:2], exp([0.0, 1.0, xi[2]])[:2]])
    out = x.copy()
    out[:2] = R @ x[:2] + V @ xi[:2]
    out[2] = x[2] + xi[2]
    for i in range(3, len(x), 2):
        out[i : i + 2] = R @ x[i : i + 2] + V @ xi[i : i + 2]
    return out
