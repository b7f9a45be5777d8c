"""EKF-SLAM as many write it: a class with other method names, speed and yaw rate over dt, and ids in a dict."""

import numpy as np


class EkfSlam:
    def __init__(self, x0, P0, Q, R):
        self.x, self.P = x0, P0
        self.Q, self.R = Q, R  # (2, 2) of speed [m/s] and yaw rate [rad/s]; (2, 2) of range and bearing
        self.index = {}  # place of each landmark in the state

    def motion_update(self, v, w, dt):
        c, s = np.cos(self.x[2]), np.sin(self.x[2])
        F, B = np.eye(len(self.x)), np.zeros((len(self.x), 2))
        F[0, 2], F[1, 2] = -v * dt * s, v * dt * c
        B[:3] = [dt * c, 0], [dt * s, 0], [0, dt]
        self.x = self.x + B @ [v, w]
        self.P = F @ self.P @ F.T + B @ self.Q @ B.T

    def sensor_update(self, scan):
        """Correct with the known landmarks of a scan [(id, range, bearing), ...], then add the others."""
        known = [each for each in scan if each[0] in self.index]
        H, y = np.zeros((2 * len(known), len(self.x))), np.zeros(2 * len(known))
        for i, (name, r, bearing) in enumerate(known):
            at = self.index[name]
            dx, dy = self.x[at : at + 2] - self.x[:2]
            d = np.hypot(dx, dy)
            G = np.array([[dx / d, dy / d], [-dy / d**2, dx / d**2]])
            H[2 * i : 2 * i + 2, :2], H[2 * i : 2 * i + 2, at : at + 2], H[2 * i + 1, 2] = -G, G, -1
            turn = bearing - np.arctan2(dy, dx) + self.x[2]
            y[2 * i : 2 * i + 2] = r - d, (turn + np.pi) % (2 * np.pi) - np.pi
        if known:
            S = H @ self.P @ H.T + np.kron(np.eye(len(known)), self.R)
            K = self.P @ H.T @ np.linalg.inv(S)
            self.x, self.P = self.x + K @ y, self.P - K @ S @ K.T
        for each in scan:
            if each[0] not in self.index:
                self.add_landmark(*each)

    def add_landmark(self, name, r, bearing):
        self.index[name] = len(self.x)
        c, s = np.cos(self.x[2] + bearing), np.sin(self.x[2] + bearing)
        Jr, Jz = np.array([[1, 0, -r * s], [0, 1, r * c]]), np.array([[c, -r * s], [s, r * c]])
        self.x = np.append(self.x, self.x[:2] + np.array([r * c, r * s]))
        cross = Jr @ self.P[:3]
        self.P = np.block([[self.P, cross.T], [cross, Jr @ self.P[:3, :3] @ Jr.T + Jz @ self.R @ Jz.T]])
