"""EKF-SLAM as the Octave course divides it: two functions, and a state with a place for every landmark."""

import numpy as np

MOTION_NOISE = np.diag([0.03, 0.03, 0.005]) ** 2  # covariance of a step, world frame [m^2, rad^2]
SENSOR_NOISE = np.diag([0.1, 0.09]) ** 2  # covariance of range and bearing [m^2, rad^2]


def prediction_step(mu, sigma, u):
    """Turn by u["r1"], drive u["t"], turn by u["r2"]."""
    way = mu[2] + u["r1"]
    G = np.eye(len(mu))
    G[0, 2], G[1, 2] = -u["t"] * np.sin(way), u["t"] * np.cos(way)
    mu = mu.copy()
    mu[:3] += u["t"] * np.cos(way), u["t"] * np.sin(way), u["r1"] + u["r2"]
    sigma = G @ sigma @ G.T
    sigma[:3, :3] += MOTION_NOISE
    return mu, sigma


def correction_step(mu, sigma, z, observed):
    """Correct with all observed landmarks of the scan at once, then place the new ones (id, range, bearing)."""
    old = [each for each in z if observed[each["id"]]]
    H, innovation = np.zeros((2 * len(old), len(mu))), np.zeros(2 * len(old))
    for i, each in enumerate(old):
        at, rows = 3 + 2 * each["id"], slice(2 * i, 2 * i + 2)
        dx, dy = mu[at : at + 2] - mu[:2]
        q, r = dx**2 + dy**2, np.hypot(dx, dy)
        H[rows, :3] = [-dx / r, -dy / r, 0], [dy / q, -dx / q, -1]
        H[rows, at : at + 2] = [dx / r, dy / r], [-dy / q, dx / q]
        turn = each["bearing"] - np.arctan2(dy, dx) + mu[2]
        innovation[rows] = each["range"] - r, (turn + np.pi) % (2 * np.pi) - np.pi
    if old:
        S = H @ sigma @ H.T + np.kron(np.eye(len(old)), SENSOR_NOISE)
        K = sigma @ H.T @ np.linalg.inv(S)
        mu, sigma = mu + K @ innovation, sigma - K @ S @ K.T
    for each in z:
        if not observed[each["id"]]:
            observed[each["id"]], at = True, 3 + 2 * each["id"]
            c, s, r = np.cos(mu[2] + each["bearing"]), np.sin(mu[2] + each["bearing"]), each["range"]
            mu[at : at + 2] = mu[:2] + np.array([r * c, r * s])
            by_pose, by_sight = np.array([[1, 0, -r * s], [0, 1, r * c]]), np.array([[c, -r * s], [s, r * c]])
            sigma[at : at + 2, :] = by_pose @ sigma[:3, :]
            sigma[:, at : at + 2] = sigma[at : at + 2, :].T
            own = by_pose @ sigma[:3, :3] @ by_pose.T + by_sight @ SENSOR_NOISE @ by_sight.T
            sigma[at : at + 2, at : at + 2] = own
    return mu, sigma, observed
