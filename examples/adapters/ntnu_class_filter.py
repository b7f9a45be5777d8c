"""EKF-SLAM as NTNU's course divides it: a class without a state; eta and P are passed in and returned, z is flat.

This one is written for the example. It associates each observation with the nearest landmark.
"""

import numpy as np

GATE = 13.8  # squared Mahalanobis distance


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def rotmat(psi):
    return np.array([[np.cos(psi), -np.sin(psi)], [np.sin(psi), np.cos(psi)]])


class EKFSLAM:
    def __init__(self, Q, R):
        self.Q, self.R = Q, R  # (3, 3) of the odometry in the robot's frame; (2, 2) of range and bearing

    def f(self, x, u):
        return np.append(x[:2] + rotmat(x[2]) @ u[:2], wrap(x[2] + u[2]))

    def Fx(self, x, u):
        F = np.eye(3)
        F[:2, 2] = rotmat(x[2]) @ [-u[1], u[0]]
        return F

    def Fu(self, x, u):
        F = np.eye(3)
        F[:2, :2] = rotmat(x[2])
        return F

    def predict(self, eta, P, z_odo):
        Fx, Fu = self.Fx(eta[:3], z_odo), self.Fu(eta[:3], z_odo)
        eta, P = eta.copy(), P.copy()
        eta[:3] = self.f(eta[:3], z_odo)
        P[:3, :] = Fx @ P[:3, :]
        P[:, :3] = P[:, :3] @ Fx.T
        P[:3, :3] += Fu @ self.Q @ Fu.T
        return eta, P

    def h(self, eta):
        dx, dy = (eta[3:].reshape(-1, 2) - eta[:2]).T
        return np.column_stack([np.hypot(dx, dy), wrap(np.arctan2(dy, dx) - eta[2])]).ravel()

    def h_jac(self, eta):
        H = np.zeros((len(eta) - 3, len(eta)))
        for i, (dx, dy) in enumerate(eta[3:].reshape(-1, 2) - eta[:2]):
            r = np.hypot(dx, dy)
            G = np.array([[dx / r, dy / r], [-dy / r**2, dx / r**2]])
            H[2 * i : 2 * i + 2, :3] = np.column_stack([-G, [0, -1]])
            H[2 * i : 2 * i + 2, 3 + 2 * i : 5 + 2 * i] = G
        return H

    def associate(self, z, zpred, S):
        """Return the landmark of each observation, -1 for a new one."""
        a = np.full(len(z) // 2, -1)
        for i, each in enumerate(z.reshape(-1, 2)):
            v = each - zpred.reshape(-1, 2)
            v[:, 1] = wrap(v[:, 1])
            d = [vj @ np.linalg.solve(S[2 * j : 2 * j + 2, 2 * j : 2 * j + 2], vj) for j, vj in enumerate(v)]
            if d and min(d) < GATE:
                a[i] = np.argmin(d)
        return a

    def add_landmarks(self, eta, P, z):
        for r, bearing in z.reshape(-1, 2):
            c, s = np.cos(eta[2] + bearing), np.sin(eta[2] + bearing)
            Gx, Gz = np.array([[1, 0, -r * s], [0, 1, r * c]]), np.array([[c, -r * s], [s, r * c]])
            eta = np.append(eta, eta[:2] + np.array([r * c, r * s]))
            cross = Gx @ P[:3, :]
            P = np.block([[P, cross.T], [cross, Gx @ P[:3, :3] @ Gx.T + Gz @ self.R @ Gz.T]])
        return eta, P

    def update(self, eta, P, z):
        """Return eta, P, the NIS, and the landmark of each observation before the update."""
        zpred, H = self.h(eta), self.h_jac(eta)
        S = H @ P @ H.T + np.kron(np.eye(len(zpred) // 2), self.R)
        a = self.associate(z, zpred, S)
        rows = (2 * a[a >= 0, None] + [0, 1]).ravel()
        v = z.reshape(-1, 2)[a >= 0] - zpred[rows].reshape(-1, 2)
        v[:, 1] = wrap(v[:, 1])
        H, v, NIS = H[rows], v.ravel(), 0.0
        if len(v):
            S = H @ P @ H.T + np.kron(np.eye(len(v) // 2), self.R)
            W = P @ H.T @ np.linalg.inv(S)
            eta, P, NIS = eta + W @ v, P - W @ S @ W.T, v @ np.linalg.solve(S, v)
        eta, P = self.add_landmarks(eta, P, z.reshape(-1, 2)[a < 0].ravel())
        return eta, P, NIS, a
