"""Made-up files in the styles of the exercise and of PythonRobotics, as texts, with seeded bugs."""

from __future__ import annotations

# states are columns (n, 1) whose elements are used as numbers: numpy refuses that since 2.4
COLUMNS = """
import math
import numpy as np

DT = 0.1
M_DIST_TH = 9.0
KNOWN_DATA_ASSOCIATION = 1
Q = np.diag([0.5, 0.2]) ** 2
Py = np.diag([0.3, 0.2]) ** 2
seen = []


def wrap(a):
    return (a + math.pi) % (2 * math.pi) - math.pi


def count(x):
    return (len(x) - 3) // 2


def move(x, u):
    v, w = float(u[0]), float(u[1])
    return np.array([[x[0, 0] + DT * v * math.cos(x[2])], [x[1, 0] + DT * v * math.sin(x[2])], [x[2, 0] + DT * w]])


def move_jacobians(x, u):
    A = np.array([[1.0, 0.0, -DT * u[0] * math.sin(x[2])], [0.0, 1.0, DT * u[0] * math.cos(x[2])], [0.0, 0.0, 1.0]])
    B = np.array([[DT * math.cos(x[2]), 0.0], [DT * math.sin(x[2]), 0.0], [0.0, DT]])
    return A, B


def see(x, j):
    d = x[3 + 2 * j : 5 + 2 * j] - x[0:2]
    q = float(d.T @ d)
    r = math.sqrt(q)
    H = np.zeros((2, len(x)))
    H[0, 0], H[0, 1] = -d[0] / r, -d[1] / r
    H[1, 0], H[1, 1], H[1, 2] = d[1] / q, -d[0] / q, -1.0
    H[:, 3 + 2 * j : 5 + 2 * j] = -H[:, 0:2]
    return np.array([[r], [math.atan2(d[1], d[0]) - x[2, 0]]]), H


def innovation(x, P, yi, j):
    expected, H = see(x, j)
    e = yi[0:2].reshape(2, 1) - expected
    e[1] = wrap(e[1])
    return e, H @ P @ H.T + Py, H


def nearest(x, P, yi):
    distances = []
    for j in range(count(x)):
        e, S, _ = innovation(x, P, yi, j)
        distances.append(float(e.T @ np.linalg.inv(S) @ e))
    distances.append(M_DIST_TH)
    return distances.index(min(distances))


def number(x, P, yi):
    if not KNOWN_DATA_ASSOCIATION:
        return nearest(x, P, yi)
    if yi[2] not in seen:
        seen.append(yi[2])
    return seen.index(yi[2])


def add(x, P, yi):
    a = x[2] + yi[1]
    position = np.zeros((2, 1))
    position[0, 0], position[1, 0] = x[0] + yi[0] * math.cos(a), x[1] + yi[0] * math.sin(a)
    Jr = np.array([[1.0, 0.0, -yi[0] * math.sin(a)], [0.0, 1.0, yi[0] * math.cos(a)]])
    Jy = np.array([[math.cos(a), -yi[0] * math.sin(a)], [math.sin(a), yi[0] * math.cos(a)]])
    side = Jr @ P[0:3, :]
    corner = Jr @ P[0:3, 0:3] @ Jr.T + Jy @ Py @ Jy.T
    return np.vstack((x, position)), np.vstack((np.hstack((P, side.T)), np.hstack((side, corner))))


def ekf_slam(xEst, PEst, u, y):
    A, B = move_jacobians(xEst, u)
    xEst[0:3] = move(xEst, u)
    PEst[0:3, 0:3] = A @ PEst[0:3, 0:3] @ A.T + B @ Q @ B.T
    PEst[0:3, 3:] = A @ PEst[0:3, 3:]
    PEst[3:, 0:3] = PEst[0:3, 3:].T
    for i in range(len(y[:, 0])):
        j = number(xEst, PEst, y[i])
        if j == count(xEst):
            xEst, PEst = add(xEst, PEst, y[i])
            continue
        e, S, H = innovation(xEst, PEst, y[i], j)
        K = PEst @ H.T @ np.linalg.inv(S)
        xEst = xEst + K @ e
        PEst = (np.eye(len(xEst)) - K @ H) @ PEst
    xEst[2] = wrap(xEst[2])
    return xEst, PEst


if __name__ == "__main__":
    ekf_slam(np.zeros((3, 1)), np.eye(3), np.array([[1.0, 0.1]]).T, np.zeros((0, 3)))
"""

# settings are parameters, and only the main program has their values
_SETTINGS = "M_DIST_TH = 9.0\nKNOWN_DATA_ASSOCIATION = 1\nQ = np.diag([0.5, 0.2]) ** 2\nPy = np.diag([0.3, 0.2]) ** 2\n"
PARAMETERS = (
    COLUMNS.replace(_SETTINGS, "")
    .replace("(x, P, yi, j)", "(x, P, yi, j, Py)")
    .replace("innovation(xEst, PEst, y[i], j)", "innovation(xEst, PEst, y[i], j, Py)")
    .replace("nearest(x, P, yi)", "nearest(x, P, yi, M_DIST_TH, Py)")
    .replace("number(x, P, yi)", "number(x, P, yi, M_DIST_TH, KNOWN_DATA_ASSOCIATION, Py)")
    .replace("number(xEst, PEst, y[i])", "number(xEst, PEst, y[i], M_DIST_TH, KNOWN_DATA_ASSOCIATION, Py)")
    .replace("add(x, P, yi)", "add(x, P, yi, Py)")
    .replace("add(xEst, PEst, y[i])", "add(xEst, PEst, y[i], Py)")
    .replace("u, y):", "u, y, M_DIST_TH, KNOWN_DATA_ASSOCIATION, Q, Py):")
)
OWN_ASSOCIATION = COLUMNS.replace("KNOWN_DATA_ASSOCIATION = 1", "KNOWN_DATA_ASSOCIATION = 0").replace(
    "M_DIST_TH = 9.0", "M_DIST_TH = 25.0"
)

# copies of PythonRobotics: covariance Cx of the motion in a step, R of an observation, own association, z for y; noise
# and M_DIST_TH are those of its simulation
_NOISE = "Cx = np.diag([0.5, 0.5, math.radians(30.0)]) ** 2\n"
ROBOTICS = (
    COLUMNS.replace(_SETTINGS, f"M_DIST_TH = 2.0\n{_NOISE}R = np.diag([0.5, 0.5]) ** 2\n")
    .replace("KNOWN_DATA_ASSOCIATION", "False")
    .replace("Py", "R")
    .replace("B @ Q @ B.T", "Cx")
    .replace("u, y):", "u, z):\n    y = z")
)

# its noise of an observation is a part of Cx
ONE_NOISE = ROBOTICS.replace("R = np.diag([0.5, 0.5]) ** 2\n", "").replace("@ R @", "@ Cx[0:2, 0:2] @")
ONE_NOISE = ONE_NOISE.replace("+ R,", "+ Cx[0:2, 0:2],")

# the same file with matrices of numpy, for which * is the product
MATRICES = (
    ROBOTICS.replace(" @ ", " * ")
    .replace("np.array(", "np.matrix(")
    .replace("y = z", "y = np.asarray(z)")
    .replace("np.zeros((2, len(x)))", "np.matrix(np.zeros((2, len(x))))")
)

# question 4 with rays that begin with three members (Sola 2005): a third value that begins as []; y = [bearing, id]
RAYS = """
import numpy as np

DT = 0.1
Q = np.diag([0.5, 0.2]) ** 2
Py = np.array([[0.2]]) ** 2
DISTANCES, ALPHA = (4.0, 6.8, 11.6), 0.25


def wrap(a):
    return (a + np.pi) % (2 * np.pi) - np.pi


def innovation(x, P, j, b):
    k = 3 + 2 * j
    dx, dy = x[k] - x[0], x[k + 1] - x[1]
    q = dx**2 + dy**2
    H = np.zeros(len(x))
    H[:3], H[k : k + 2] = (dy / q, -dx / q, -1), (-dy / q, dx / q)
    return wrap(b - np.arctan2(dy, dx) + x[2]), H @ P @ H + Py[0, 0], H


def begin(x, P, b, name, rays):
    c, s, robot = np.cos(x[2] + b), np.sin(x[2] + b), x[:2].copy()
    for r in DISTANCES:
        Jr, Jy = np.array([[1, 0, -r * s], [0, 1, r * c]]), np.array([[c, -r * s], [s, r * c]])
        side = Jr @ P[:3]
        corner = side[:, :3] @ Jr.T + Jy @ np.diag([(ALPHA * r) ** 2, Py[0, 0]]) @ Jy.T
        x, P = np.append(x, robot + [r * c, r * s]), np.block([[P, side.T], [side, corner]])
        rays.append((name, 1 / len(DISTANCES)))
    return x, P


def weigh(x, P, b, mine, rays):
    weights = np.zeros(len(rays))
    for j in mine:
        nu, S, _ = innovation(x, P, j, b)
        weights[j] = rays[j][1] * np.exp(-(nu**2) / (2 * S)) / np.sqrt(S)
    weights /= weights.sum()
    kept = [j for j in range(len(rays)) if j not in mine or weights[j] > 0.0003]
    at = np.r_[0:3, [3 + 2 * j + i for j in kept for i in (0, 1)]].astype(int)
    rays = [(rays[j][0], weights[j] if j in mine else rays[j][1]) for j in kept]
    return x[at], P[np.ix_(at, at)], rays


def ekf_slam(xEst, PEst, u, y, rays):
    # rays: id and weight of each point of the state
    x, c, s = xEst[:, 0], np.cos(xEst[2, 0]), np.sin(xEst[2, 0])
    F, G = np.eye(len(x)), np.zeros((len(x), 2))
    F[:2, 2] = -DT * u[0, 0] * s, DT * u[0, 0] * c
    G[:3] = [[DT * c, 0], [DT * s, 0], [0, DT]]
    x, P = x + G @ u[:, 0], F @ PEst @ F.T + G @ Q @ G.T
    for row in y:
        b, name = row[-2], row[-1]
        mine = [j for j, ray in enumerate(rays) if ray[0] == name]
        if not mine:
            x, P = begin(x, P, b, name, rays)
            continue
        if len(mine) > 1:
            x, P, rays = weigh(x, P, b, mine, rays)
        mine = [j for j, ray in enumerate(rays) if ray[0] == name]
        for j in mine:
            share = rays[j][1] if len(mine) > 1 else 1.0
            if share > 0.05:
                nu, S, H = innovation(x, P, j, b)
                S += Py[0, 0] * (1 / share - 1)
                K = P @ H / S
                x, P = x + K * nu, P - np.outer(K, K) * S
    return x[:, None], P, rays
"""

BUGS = {
    "sign": ("0.0, -DT * u[0] * math.sin(x[2])]", "0.0, DT * u[0] * math.sin(x[2])]"),
    "wrap": ("    e[1] = wrap(e[1])\n", ""),
    "cross": ("    side = Jr @ P[0:3, :]\n", "    side = 0 * (Jr @ P[0:3, :])\n"),
}
