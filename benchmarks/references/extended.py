"""Filters in extended precision, with the start as origin: a reference where two double-precision forms differ.

`numpy.longdouble` has 64 bits of mantissa on x86, 113 or 106 on most other machines, and 53 on some. With 53 bits
`DIGITS_GAINED` is 1 and results are undecided. The filters follow the papers that `tests/reference/textbook.py` names.
The iterated filter differs from that module: it is damped, and takes as many passes as it needs to reach a minimum of
its own cost, the sum of the prior's and the scan's.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from slamgauge.arrays import Float, Int
from slamgauge.recording import Recording

Long = NDArray[Any]  # dtype numpy.longdouble

DIGITS_GAINED = float(np.finfo(np.float64).eps / np.finfo(np.longdouble).eps)
MIN_BEARING_DISTANCE = 0.01  # m; as in our filters: a bearing to a closer landmark has no information
MAX_PASSES = 50
SETTLED = 1e-15  # m or rad
DIFFERENCE = np.longdouble(1e-6)  # m or rad, for second derivatives
SHORTEST = 1e-9  # share of a pass; if this share does not lower the cost, only rounding is left
TWO_PI = 8 * np.arctan(np.longdouble(1))
SKEW = np.array([[0, -1], [1, 0]], dtype=np.longdouble)


class Path(NamedTuple):
    """Poses (N+1, 3) relative to the prior's mean position, and sigmas (N+1, 3) of the additive error."""

    poses: Float
    sigmas: Float


def extended(recording: Recording, kind: str) -> Path:
    """Run the filter of that name (`ekf`, `fej-ekf`, `oc-ekf`, `iekf`, `riekf`) in extended precision."""
    run = _Filter(recording, kind)
    poses, sigmas = [], []
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            run.predict(as_long(recording.odometry[k - 1]), as_long(recording.odometry_cov[k - 1]))
        assert scan.landmark is not None
        run.update(scan.landmark, as_long(scan.value), as_long(scan.cov))
        poses.append(run.x[:3].astype(np.float64))
        sigmas.append(np.sqrt(np.maximum(run.pose_variances(), 0)).astype(np.float64))
    return Path(np.array(poses), np.array(sigmas))


class _Filter:
    """State x (n,), covariance P (n, n) of the filter's own error, and first estimates."""

    def __init__(self, recording: Recording, kind: str) -> None:
        self.kind, self.sensor = kind, recording.sensor
        self.x = as_long([0.0, 0.0, recording.prior_mean[2]])
        self.P = as_long(recording.prior_cov)  # at the origin the additive and the invariant error are equal
        self.first = self.x.copy()
        self.slots: dict[int, int] = {}

    def pose_variances(self) -> Long:
        """Return the variances (3,) of the pose's additive error."""
        P = self.P[:3, :3]
        if self.kind == "riekf":
            D = np.eye(3, dtype=np.longdouble)
            D[:2, 2] = SKEW @ self.x[:2]
            P = D @ P @ D.T
        return np.diag(P)

    def predict(self, increment: Long, Q: Long) -> None:
        size, begin = len(self.x), self.x[:3].copy()
        self.x[:2] = self.x[:2] + long_rotation(begin[2]) @ increment[:2]
        self.x[2] = long_wrap(begin[2] + increment[2])
        G = np.zeros((size, 3), dtype=np.longdouble)
        G[:2, :2], G[2, 2] = long_rotation(begin[2]), 1
        if self.kind == "riekf":
            for i in (0, *range(3, size, 2)):
                G[i : i + 2, 2] = -SKEW @ self.x[i : i + 2]
        else:
            point = self.first if self.kind in ("fej-ekf", "oc-ekf") else begin
            F = np.eye(size, dtype=np.longdouble)
            F[:2, 2] = SKEW @ (self.x[:2] - point[:2])
            self.P = F @ self.P @ F.T
        self.P = self.P + G @ Q @ G.T
        self.first[:3] = self.x[:3]

    def update(self, ids: Int, values: Long, covs: Long) -> None:
        """Correct with mapped landmarks, map the others, and correct with further observations of those."""
        mapped = np.array([name in self.slots for name in ids.tolist()], dtype=bool)
        first = np.zeros(len(ids), dtype=bool)
        first[np.unique(ids, return_index=True)[1]] = True
        self._correct(ids[mapped], values[mapped], covs[mapped])
        for row in np.flatnonzero(first & ~mapped).tolist():
            self._append(int(ids[row]), values[row], covs[row])
        again = ~first & ~mapped
        self._correct(ids[again], values[again], covs[again])

    def _correct(self, ids: Int, values: Long, covs: Long) -> None:
        if not len(ids):
            return
        columns = [3 + 2 * self.slots[name] for name in ids.tolist()]
        R = as_long(block_diag(*covs))
        if self.kind == "iekf":
            self._correct_iterated(columns, values, R)
            return
        H = self._jacobian(columns)
        W, y = _whitened(self.P, H, R, innovation(self.sensor, self.x, columns, values))
        self.P = self.P - W.T @ W
        dx = W.T @ y
        self.x = _turned(dx, self.x) if self.kind == "riekf" else self.x + dx
        self.x[2] = long_wrap(self.x[2])

    def _correct_iterated(self, columns: list[int], values: Long, R: Long) -> None:
        """Take damped Gauss-Newton steps on d'P^-1 d + v'R^-1 v with d = P y, so that P may be singular."""
        start, P = self.x, self.P
        at: Long = start.copy()
        y: Long = np.zeros_like(start)
        noise = _cholesky(R)

        def cost(x: Long, y: Long) -> Any:
            white = _forward(noise, innovation(self.sensor, x, columns, values))
            return (y @ P @ y + white @ white) / 2

        before = cost(at, y)
        for _ in range(MAX_PASSES):
            H = self._jacobian(columns, at)
            factor = _cholesky(H @ P @ H.T + R)
            error = innovation(self.sensor, at, columns, values) - H @ (start - at)
            y_next = H.T @ _backward(factor, _forward(factor, error))
            share, y_tried = 1.0, y_next
            tried: Long = start + P @ y_next
            while not cost(tried, y_tried) <= before and share > SHORTEST:
                share = share / 2
                y_tried = y + share * (y_next - y)
                tried = start + P @ y_tried
            moved = np.abs(tried - at).max()
            if share <= SHORTEST or moved < SETTLED:
                break
            at, y, before = tried, y_tried, cost(tried, y_tried)
        at = self._polished(columns, values, noise, at, y)
        H = self._jacobian(columns, at)
        W, _ = _whitened(P, H, R, np.zeros(len(R), dtype=np.longdouble))
        self.x, self.P = at, P - W.T @ W
        self.x[2] = long_wrap(self.x[2])

    def _polished(self, columns: list[int], values: Long, noise: Long, at: Long, y: Long) -> Long:
        """Solve y = H'R^-1 v at x^ + P y by Newton steps as long as they become shorter.

        Damped Gauss-Newton is slow where residuals are large, and ends where differences of the cost are rounding.
        """
        start, P, length = self.x, self.P, math.inf
        while True:
            H = self._jacobian(columns, at)
            weights = _backward(noise, _forward(noise, innovation(self.sensor, at, columns, values)))
            bent = self._curvature(columns, at, weights)
            normal = H.T @ np.column_stack([_backward(noise, _forward(noise, each)) for each in H.T])
            slope = np.eye(len(y), dtype=np.longdouble) + (normal - bent) @ P
            moved = P @ (step := solved(slope, H.T @ weights - y))
            if not np.abs(moved).max() < length / 2:
                return at
            y = y + step
            at, length = start + P @ y, np.abs(moved).max()

    def _curvature(self, columns: list[int], at: Long, weights: Long) -> Long:
        """Return the sum of weights_k d^2 h_k / dx^2, by differences of H' weights."""
        C = np.zeros((len(at), len(at)), dtype=np.longdouble)
        for column in {0, 1, 2, *columns, *(c + 1 for c in columns)}:
            ahead, behind = at.copy(), at.copy()
            ahead[column], behind[column] = at[column] + DIFFERENCE, at[column] - DIFFERENCE
            change = self._jacobian(columns, ahead) - self._jacobian(columns, behind)
            C[:, column] = change.T @ weights / (2 * DIFFERENCE)
        return C

    def _jacobian(self, columns: list[int], at: Long | None = None) -> Long:
        H = jacobian(self.sensor, self.first if self.kind == "fej-ekf" else self.x if at is None else at, columns)
        if self.kind == "riekf":
            H[:, 2] = 0
        if self.kind == "oc-ekf":
            for a, c in enumerate(columns):
                rows, around = slice(2 * a, 2 * a + 2), [0, 1, 2, c, c + 1]
                H[rows, around] = H[rows, around] @ self._observable(c)
        return H

    def _observable(self, column: int) -> Long:
        """Return I - N (N'N)^-1 N' (5, 5) for shift and turn of robot and landmark at their first estimates."""
        N = np.zeros((5, 3), dtype=np.longdouble)
        N[:2, :2] = N[3:, :2] = np.eye(2)
        N[2, 2] = 1
        N[:2, 2] = SKEW @ self.first[:2]
        N[3:, 2] = SKEW @ self.first[column : column + 2]
        half = _forward(_cholesky(N.T @ N), N.T)
        return np.eye(5, dtype=np.longdouble) - half.T @ half

    def _append(self, name: int, z: Long, R: Long) -> None:
        delta, Jz = z, np.eye(2, dtype=np.longdouble)
        if self.sensor != "position":
            c, s = np.cos(z[1]), np.sin(z[1])
            delta = np.array([z[0] * c, z[0] * s])
            Jz = np.array([[c, -z[0] * s], [s, z[0] * c]])
        turn = long_rotation(self.x[2])
        landmark = self.x[:2] + turn @ delta
        by_state = np.zeros((2, len(self.x)), dtype=np.longdouble)
        by_state[:, :2] = np.eye(2)
        if self.kind != "riekf":
            point = self.first if self.kind in ("fej-ekf", "oc-ekf") else self.x
            by_state[:, 2] = SKEW @ (landmark - point[:2])
        T = np.vstack([np.eye(len(self.x), dtype=np.longdouble), by_state])
        self.P = T @ self.P @ T.T
        self.P[-2:, -2:] += turn @ Jz @ R @ Jz.T @ turn.T
        self.slots[name] = (len(self.x) - 3) // 2
        self.x, self.first = np.concatenate([self.x, landmark]), np.concatenate([self.first, landmark])


def innovation(sensor: str, x: Long, columns: list[int], values: Long) -> Long:
    """Return innovations (2m,) of observations `values` (m, 2) of landmarks that begin in these columns of x."""
    v = np.zeros(2 * len(columns), dtype=np.longdouble)
    for a, c in enumerate(columns):
        delta = long_rotation(x[2]).T @ (x[c : c + 2] - x[:2])
        if sensor == "position":
            v[2 * a : 2 * a + 2] = values[a] - delta
            continue
        distance = np.hypot(delta[0], delta[1])
        v[2 * a] = values[a, 0] - distance
        if distance >= MIN_BEARING_DISTANCE:
            v[2 * a + 1] = long_wrap(values[a, 1] - np.arctan2(delta[1], delta[0]))
    return v


def jacobian(sensor: str, x: Long, columns: list[int]) -> Long:
    """Return the derivatives (2m, n) of the predicted observations by x."""
    H, to_body = np.zeros((2 * len(columns), len(x)), dtype=np.longdouble), long_rotation(x[2]).T
    for a, c in enumerate(columns):
        offset = x[c : c + 2] - x[:2]
        B = _by_delta(sensor, to_body @ offset) @ to_body
        rows = slice(2 * a, 2 * a + 2)
        H[rows, :2], H[rows, 2], H[rows, c : c + 2] = -B, -B @ SKEW @ offset, B
    return H


def _by_delta(sensor: str, delta: Long) -> Long:
    """Return the derivatives (2, 2) of an observation by the landmark in the body frame."""
    if sensor == "position":
        return np.eye(2, dtype=np.longdouble)
    distance = np.hypot(delta[0], delta[1])
    A = np.zeros((2, 2), dtype=np.longdouble)
    if distance > 0:
        A[0] = delta / distance
    if distance >= MIN_BEARING_DISTANCE:
        A[1] = SKEW @ delta / distance**2
    return A


def _turned(xi: Long, x: Long) -> Long:
    """Return exp(xi) acting from the left on robot and landmarks."""
    t = xi[2]
    half = np.sin(t / 2)
    V = np.eye(2, dtype=np.longdouble)
    if t != 0:
        V = (np.sin(t) * np.eye(2) + 2 * half**2 * SKEW) / t
    out = x.copy()
    for i in (0, *range(3, len(x), 2)):
        out[i : i + 2] = long_rotation(t) @ x[i : i + 2] + V @ xi[i : i + 2]
    out[2] = x[2] + t
    return out


def _whitened(P: Long, H: Long, R: Long, v: Long) -> tuple[Long, Long]:
    """Return W = L^-1 H P and y = L^-1 v with L L' = H P H' + R: the gain is W' L^-1."""
    HP = H @ P
    factor = _cholesky(HP @ H.T + R)
    return _forward(factor, HP), _forward(factor, v)


def _cholesky(A: Long) -> Long:
    """Return the lower L with L L' = A; NaN where A is not positive definite."""
    size = len(A)
    L = np.zeros((size, size), dtype=np.longdouble)
    for j in range(size):
        column = A[j:, j] - L[j:, :j] @ L[j, :j]
        L[j:, j] = column / np.sqrt(column[0]) if column[0] > 0 else math.nan
    return L


def _forward(L: Long, B: Long) -> Long:
    """Return L^-1 B."""
    out = np.zeros(B.shape, dtype=np.longdouble)
    for i in range(len(L)):
        out[i] = (B[i] - L[i, :i] @ out[:i]) / L[i, i]
    return out


def _backward(L: Long, b: Long) -> Long:
    """Return L'^-1 b."""
    out = np.zeros(b.shape, dtype=np.longdouble)
    for i in range(len(L) - 1, -1, -1):
        out[i] = (b[i] - L[i + 1 :, i] @ out[i + 1 :]) / L[i, i]
    return out


def solved(A: Long, b: Long) -> Long:
    """Return A^-1 b by elimination with pivots; NaN where A is singular."""
    A, b = A.copy(), b.copy()
    for i in range(len(b)):
        pivot = i + int(np.argmax(np.abs(A[i:, i])))
        A[[i, pivot]], b[[i, pivot]] = A[[pivot, i]], b[[pivot, i]]
        factors = A[i + 1 :, i] / A[i, i]
        A[i + 1 :] -= np.outer(factors, A[i])
        b[i + 1 :] -= factors * b[i]
    for i in range(len(b) - 1, -1, -1):
        b[i] = (b[i] - A[i, i + 1 :] @ b[i + 1 :]) / A[i, i]
    return b


def long_rotation(heading: Any) -> Long:
    c, s = np.cos(heading), np.sin(heading)
    return np.array([[c, -s], [s, c]])


def long_wrap(angle: Any) -> Any:
    return angle - TWO_PI * np.ceil((angle - TWO_PI / 2) / TWO_PI)


def as_long(values: object) -> Long:
    return np.array(values, dtype=np.longdouble)
