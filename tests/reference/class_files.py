"""Made-up files in the styles of online classes and of NTNU's course, as text; tests change lines of them."""

from __future__ import annotations

GROWING = """import numpy as np


def wrap(a):
    return (a + np.pi) % (2 * np.pi) - np.pi


class EkfSlam:
    def __init__(self, x0, P0, Q, R):
        self.mu = np.array(x0, dtype=float)
        self.Sigma = np.array(P0, dtype=float)
        self.Q, self.R = Q, R
        self.index = {}

    def predict(self, v, w, dt):
        th = self.mu[2]
        n = len(self.mu)
        self.mu[:3] += [v * dt * np.cos(th), v * dt * np.sin(th), w * dt]
        self.mu[2] = wrap(self.mu[2])
        F = np.eye(n)
        F[0, 2], F[1, 2] = -v * dt * np.sin(th), v * dt * np.cos(th)
        G = np.zeros((n, 2))
        G[:3] = [[dt * np.cos(th), 0], [dt * np.sin(th), 0], [0, dt]]
        self.Sigma = F @ self.Sigma @ F.T + G @ self.Q @ G.T

    def update(self, z, landmark_id):
        if landmark_id not in self.index:
            self.add(z, landmark_id)
            return
        k = 3 + 2 * self.index[landmark_id]
        d = self.mu[k : k + 2] - self.mu[:2]
        q = d @ d
        r = np.sqrt(q)
        H = np.zeros((2, len(self.mu)))
        H[:, :3] = [[-d[0] / r, -d[1] / r, 0], [d[1] / q, -d[0] / q, -1]]
        H[:, k : k + 2] = [[d[0] / r, d[1] / r], [-d[1] / q, d[0] / q]]
        y = z - [r, np.arctan2(d[1], d[0]) - self.mu[2]]
        y[1] = wrap(y[1])
        S = H @ self.Sigma @ H.T + self.R
        K = self.Sigma @ H.T @ np.linalg.inv(S)
        self.mu = self.mu + K @ y
        self.mu[2] = wrap(self.mu[2])
        self.Sigma = (np.eye(len(self.mu)) - K @ H) @ self.Sigma

    def add(self, z, landmark_id):
        r, b = z
        n = len(self.mu)
        self.index[landmark_id] = (n - 3) // 2
        a = self.mu[2] + b
        Gx = np.zeros((2, n))
        Gx[:, :3] = [[1, 0, -r * np.sin(a)], [0, 1, r * np.cos(a)]]
        Gz = np.array([[np.cos(a), -r * np.sin(a)], [np.sin(a), r * np.cos(a)]])
        new = self.mu[:2] + r * np.array([np.cos(a), np.sin(a)])
        self.mu = np.append(self.mu, new)
        C = Gx @ self.Sigma
        self.Sigma = np.block([[self.Sigma, C.T], [C, C @ Gx.T + Gz @ self.R @ Gz.T]])
"""

WITH_ROOM = """import math

import numpy as np


class EKF_SLAM:
    def __init__(self, n_landmarks, Q, R, dt):
        self.N = n_landmarks
        self.xEst = np.zeros((3 + 2 * self.N, 1))
        self.PEst = np.eye(3 + 2 * self.N) * 1e6
        self.PEst[:3, :3] = 0.0
        self.Q, self.R, self.dt = Q, R, dt
        self.seen = [False] * (self.N + 1)

    def prediction_step(self, u):
        v, w = u[0, 0] * self.dt, u[1, 0] * self.dt
        th = self.xEst[2, 0]
        self.xEst[0, 0] += v * math.cos(th)
        self.xEst[1, 0] += v * math.sin(th)
        self.xEst[2, 0] += w
        F = np.eye(len(self.xEst))
        F[0, 2] = -v * math.sin(th)
        F[1, 2] = v * math.cos(th)
        G = np.zeros((len(F), 2))
        G[0, 0], G[1, 0], G[2, 1] = self.dt * math.cos(th), self.dt * math.sin(th), self.dt
        self.PEst = F @ self.PEst @ F.T + G @ self.Q @ G.T

    def correction_step(self, observations):
        for obs in observations:
            j, r, b = obs["id"], obs["range"], obs["bearing"]
            k = 3 + 2 * (j - 1)
            if not self.seen[j]:
                self.seen[j] = True
                self.xEst[k, 0] = self.xEst[0, 0] + r * math.cos(b + self.xEst[2, 0])
                self.xEst[k + 1, 0] = self.xEst[1, 0] + r * math.sin(b + self.xEst[2, 0])
            dx, dy = self.xEst[k, 0] - self.xEst[0, 0], self.xEst[k + 1, 0] - self.xEst[1, 0]
            q = dx * dx + dy * dy
            s = math.sqrt(q)
            H = np.zeros((2, len(self.xEst)))
            H[0, :3] = -dx / s, -dy / s, 0
            H[1, :3] = dy / q, -dx / q, -1
            H[0, k : k + 2] = dx / s, dy / s
            H[1, k : k + 2] = -dy / q, dx / q
            y = np.array([[r - s], [b - math.atan2(dy, dx) + self.xEst[2, 0]]])
            y[1, 0] = math.atan2(math.sin(y[1, 0]), math.cos(y[1, 0]))
            S = H @ self.PEst @ H.T + self.R
            K = self.PEst @ H.T @ np.linalg.inv(S)
            self.xEst = self.xEst + K @ y
            self.PEst = (np.eye(len(self.xEst)) - K @ H) @ self.PEst
"""

NTNU = """from dataclasses import dataclass, field
import numpy as np


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def rot(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@dataclass
class EKFSLAM:
    Q: np.ndarray
    R: np.ndarray
    do_asso: bool
    alphas: np.ndarray = field(default_factory=lambda: np.array([0.001, 0.0001]))
    sensor_offset: np.ndarray = field(default_factory=lambda: np.zeros(2))

    def f(self, x, u):
        return np.append(x[:2] + rot(x[2]) @ u[:2], wrap(x[2] + u[2]))

    def Fx(self, x, u):
        F = np.eye(3)
        F[0, 2] = -u[0] * np.sin(x[2]) - u[1] * np.cos(x[2])
        F[1, 2] = u[0] * np.cos(x[2]) - u[1] * np.sin(x[2])
        return F

    def Fu(self, x, u):
        F = np.eye(3)
        F[:2, :2] = rot(x[2])
        return F

    def predict(self, eta, P, z_odo):
        assert np.allclose(P, P.T), "P is not symmetric"
        assert np.all(np.linalg.eigvals(P) >= -1e-15), "P is not positive"
        x = eta[:3]
        etapred = eta.copy()
        etapred[:3] = self.f(x, z_odo)
        F, G = self.Fx(x, z_odo), self.Fu(x, z_odo)
        P = P.copy()
        P[:3, :3] = F @ P[:3, :3] @ F.T + G @ self.Q @ G.T
        P[:3, 3:] = F @ P[:3, 3:]
        P[3:, :3] = P[:3, 3:].T
        return etapred, P

    def h(self, eta):
        m = eta[3:].reshape(-1, 2).T
        d = m - eta[:2, None]
        z = np.vstack([np.hypot(d[0], d[1]), wrap(np.arctan2(d[1], d[0]) - eta[2])])
        return z.T.ravel()

    def H(self, eta):
        n = (len(eta) - 3) // 2
        H = np.zeros((2 * n, len(eta)))
        for i in range(n):
            d = eta[3 + 2 * i : 5 + 2 * i] - eta[:2]
            r = np.linalg.norm(d)
            J = np.array([[d[0] / r, d[1] / r], [-d[1] / r**2, d[0] / r**2]])
            H[2 * i : 2 * i + 2, :2] = -J
            H[2 * i + 1, 2] = -1
            H[2 * i : 2 * i + 2, 3 + 2 * i : 5 + 2 * i] = J
        return H

    def add_landmarks(self, eta, P, z):
        for r, b in z.reshape(-1, 2):
            angle = eta[2] + b
            new = eta[:2] + r * np.array([np.cos(angle), np.sin(angle)])
            Gx = np.zeros((2, len(eta)))
            Gx[:, :2] = np.eye(2)
            Gx[:, 2] = [-r * np.sin(angle), r * np.cos(angle)]
            Gz = rot(angle) @ np.diag([1, r])
            Pn = Gx @ P @ Gx.T + Gz @ self.R @ Gz.T
            eta = np.append(eta, new)
            P = np.block([[P, P @ Gx.T], [Gx @ P, Pn]])
        return eta, P

    def associate(self, z, zpred, H, S):
        a = np.full(len(z) // 2, -1)
        for i in range(len(a)):
            best = 18.4
            for j in range(len(zpred) // 2):
                if j in a[:i]:
                    continue
                v = z[2 * i : 2 * i + 2] - zpred[2 * j : 2 * j + 2]
                v[1] = wrap(v[1])
                d = v @ np.linalg.solve(S[2 * j : 2 * j + 2, 2 * j : 2 * j + 2], v)
                if d < best:
                    best, a[i] = d, j
        return a

    def update(self, eta, P, z):
        n = (len(eta) - 3) // 2
        NIS = 1.0
        a = np.full(len(z) // 2, -1)
        if n > 0:
            zpred, H = self.h(eta), self.H(eta)
            S = H @ P @ H.T + np.kron(np.eye(n), self.R)
            a = self.associate(z, zpred, H, S)
            k = np.flatnonzero(a >= 0)
            if len(k):
                rows = np.ravel([[2 * a[i], 2 * a[i] + 1] for i in k])
                zrows = np.ravel([[2 * i, 2 * i + 1] for i in k])
                v = z[zrows] - zpred[rows]
                v[1::2] = wrap(v[1::2])
                H, S = H[rows], S[np.ix_(rows, rows)]
                W = np.linalg.solve(S, H @ P).T
                eta = eta + W @ v
                eta[2] = wrap(eta[2])
                J = np.eye(len(eta)) - W @ H
                P = J @ P @ J.T + W @ np.kron(np.eye(len(k)), self.R) @ W.T
                NIS = v @ np.linalg.solve(S, v)
        if self.do_asso:
            new = np.repeat(a == -1, 2)
            eta, P = self.add_landmarks(eta, P, z[new])
        return eta, P, NIS, a
"""
