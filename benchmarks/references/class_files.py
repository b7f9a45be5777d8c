"""Made-up submissions: one EKF-SLAM in five forms of user code, with seeded bugs, and five files that misbehave."""

from __future__ import annotations

CORE = """
import numpy as np


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def move(x, P, d, C):
    c, s = np.cos(x[2]), np.sin(x[2])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    A = np.eye(len(x))
    A[0, 2], A[1, 2] = -d[0] * s - d[1] * c, d[0] * c - d[1] * s
    x = x.copy()
    x[:3] += turn @ d
    x[2] = wrap(x[2])
    P = A @ P @ A.T
    P[:3, :3] += turn @ C @ turn.T
    return x, P


def expected(x, j):
    at = 3 + 2 * j
    dx, dy = x[at : at + 2] - x[:2]
    r = np.hypot(dx, dy)
    H = np.zeros((2, len(x)))
    H[:, :3] = [[-dx / r, -dy / r, 0.0], [dy / r**2, -dx / r**2, -1.0]]
    H[:, at : at + 2] = [[dx / r, dy / r], [-dy / r**2, dx / r**2]]
    return np.array([r, np.arctan2(dy, dx) - x[2]]), H


def innovation(x, P, j, z, R):
    h, H = expected(x, j)
    e = z - h
    e[1] = wrap(e[1])
    return e, H @ P @ H.T + R, H


def correct(x, P, j, z, R):
    e, S, H = innovation(x, P, j, z, R)
    K = P @ H.T @ np.linalg.inv(S)
    x = x + K @ e
    x[2] = wrap(x[2])
    P = P - K @ S @ K.T
    return x, (P + P.T) / 2


def place(x, z):
    return x[:2] + z[0] * np.array([np.cos(x[2] + z[1]), np.sin(x[2] + z[1])])


def add(x, P, z, R):
    c, s = np.cos(x[2] + z[1]), np.sin(x[2] + z[1])
    Jr = np.array([[1.0, 0.0, -z[0] * s], [0.0, 1.0, z[0] * c]])
    Jz = np.array([[c, -z[0] * s], [s, z[0] * c]])
    cross = Jr @ P[:3]
    corner = Jr @ P[:3, :3] @ Jr.T + Jz @ R @ Jz.T
    return np.append(x, place(x, z)), np.block([[P, cross.T], [cross, corner]])
"""

FORMS = {  # code below the core
    "step function": """
DT = 0.1
Q = np.diag([0.3, np.deg2rad(3.0)]) ** 2
Py = np.diag([0.1, np.deg2rad(5.0)]) ** 2
KNOWN_DATA_ASSOCIATION = 1
known = []


def ekf_slam(xEst, PEst, u, y):
    C = np.diag([Q[0, 0], 0.0, Q[1, 1]]) * DT**2
    x, P = move(xEst[:, 0], PEst, np.array([u[0, 0], 0.0, u[1, 0]]) * DT, C)
    for row in y:
        if row[2] in known:
            x, P = correct(x, P, known.index(row[2]), row[:2], Py)
        else:
            known.append(row[2])
            x, P = add(x, P, row[:2], Py)
    return x[:, None], P
""",
    "online class": """
class MyFilter:
    def __init__(self, prior_mean, prior_cov):
        self.x, self.P, self.landmark_ids = np.array(prior_mean), np.array(prior_cov), []

    def predict(self, increment, cov):
        self.x, self.P = move(self.x, self.P, increment, cov)

    def update(self, ids, values, covs):
        for name, z, R in zip(ids, values, covs):
            if name in self.landmark_ids:
                self.x, self.P = correct(self.x, self.P, self.landmark_ids.index(name), z, R)
            else:
                self.landmark_ids.append(name)
                self.x, self.P = add(self.x, self.P, z, R)

    @property
    def pose(self):
        return self.x[:3]

    @property
    def pose_cov(self):
        return self.P[:3, :3]

    @property
    def landmarks(self):
        return self.x[3:].reshape(-1, 2)
""",
    "Octave course": """
def prediction_step(mu, sigma, u):
    d = np.array([u.t * np.cos(u.r1), u.t * np.sin(u.r1), u.r1 + u.r2])
    return move(mu, sigma, d, np.diag([0.03, 0.0, np.deg2rad(0.3)]) ** 2)


def correction_step(mu, sigma, z, observedLandmarks):
    R = np.diag([0.1, np.deg2rad(5.0)]) ** 2
    for seen in z:
        value = np.array([seen.range, seen.bearing])
        if not observedLandmarks[seen.id]:
            at = 3 + 2 * seen.id
            mu[at : at + 2] = place(mu, value)
            observedLandmarks[seen.id] = True
        mu, sigma = correct(mu, sigma, seen.id, value, R)
    return mu, sigma, observedLandmarks
""",
    "predict and update": """
Q, R = np.eye(3), np.eye(2)


def predict(eta, P, z_odo):
    return move(eta, P, z_odo, Q)


def update(eta, P, z):
    for value in np.reshape(z, (-1, 2)):
        best, nearest = 9.0, None
        away = np.linalg.norm(np.reshape(eta[3:], (-1, 2)) - place(eta, value), axis=1)
        for j in np.flatnonzero(away < 4.0):
            e, S, _ = innovation(eta, P, j, value, R)
            distance = e @ np.linalg.solve(S, e)
            if distance < best:
                best, nearest = distance, j
        eta, P = add(eta, P, value, R) if nearest is None else correct(eta, P, nearest, value, R)
    return eta, P
""",
    "estimate(recording)": """
from slamgauge import Estimate


def estimate(recording):
    x, P, known, poses, covs = recording.prior_mean.copy(), recording.prior_cov.copy(), [], [], []
    for step, scan in enumerate(recording.scans()):
        if step:
            x, P = move(x, P, recording.odometry[step - 1], recording.odometry_cov[step - 1])
        for name, z, R in zip(scan.landmark, scan.value, scan.cov):
            if name in known:
                x, P = correct(x, P, known.index(name), z, R)
            else:
                known.append(name)
                x, P = add(x, P, z, R)
        poses.append(x[:3])
        covs.append(P[:3, :3])
    return Estimate("filtered", np.array(poses), np.array(covs), landmark_ids=known, landmarks=x[3:].reshape(-1, 2))
""",
}
BUGS = {  # text of the core, and its replacement
    "right": ("", ""),
    "sign in F": ("-d[0] * s - d[1] * c", "d[0] * s - d[1] * c"),
    "noise frame": ("turn @ C @ turn.T", "C"),
    "sign in H": ("-dx / r**2, -1.0]", "-dx / r**2, 1.0]"),
    "no wrap": ("    e[1] = wrap(e[1])\n", ""),
    "R twice": ("H @ P @ H.T + R", "H @ P @ H.T + 2 * R"),
    "half gain in P": ("P - K @ S @ K.T", "P - 0.5 * K @ S @ K.T"),
}
NO_HEADING = ("np.cos(x[2] + z[1]), np.sin(x[2] + z[1])])", "np.cos(z[1]), np.sin(z[1])])")
INSTEAD = {  # in the course's functions R is only in the file: with R twice, the file is a right filter with another R
    ("Octave course", "R twice"): ("no heading in place", NO_HEADING),
}
MISBEHAVING = {
    "crashes": (CORE + FORMS["step function"]).replace("    e = z - h\n", "    e = z - h[:5, None]\n"),
    "hangs": (CORE + FORMS["online class"]).replace("    e = z - h\n", "    while True:\n        e = z - h\n"),
    "prints": (CORE + FORMS["online class"]).replace("    e = z - h\n", "    print(100 * 'x')\n    e = z - h\n"),
    "exits": "import os\n" + (CORE + FORMS["step function"]).replace("    e = z - h\n", "    os._exit(0)\n"),
    "cheats": """
from dataclasses import replace

import slamgauge


def estimate(recording):
    return replace(slamgauge.batch(recording), kind="filtered")
""",
}


def submissions() -> dict[tuple[str, str], str]:
    """Return the text of each file by its form and its bug; forms in turn, then the files that misbehave."""
    found: dict[tuple[str, str], str] = {}
    for form, code in FORMS.items():
        for generic, change in BUGS.items():
            bug, (old, new) = INSTEAD.get((form, generic), (generic, change))
            assert CORE.count(old) == 1 or not old, bug
            found[form, bug] = (CORE.replace(old, new) if old else CORE) + code
    return found | {("misbehaving", name): text for name, text in MISBEHAVING.items()}
