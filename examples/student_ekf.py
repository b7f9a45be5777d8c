"""A correct EKF-SLAM in the style of the exercise: a step function, and settings in global variables.

slamgauge recognises this form and runs it unchanged, from this folder for example with

    slamgauge run q1-long-dense --estimators ekf,causal --out first-run
    slamgauge evaluate first-run/recording.npz --estimators ekf,causal,student_ekf.py:ekf_slam

Three other files in this folder (`student_ekf_wrong_jacobian.py`, `student_ekf_no_cross_covariance.py`,
`student_ekf_no_wrap.py`) are the same filter with one typical bug each.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DT = 0.1  # time step [s]
Q = np.diag([0.3, np.deg2rad(3.0)]) ** 2  # noise of speed [m/s] and yaw rate [rad/s]
Py = np.diag([0.1, np.deg2rad(5.0)]) ** 2  # noise of range [m] and bearing [rad]
KNOWN_DATA_ASSOCIATION = 1  # 0: by the Mahalanobis distance
M_DIST_TH = 9.0  # squared distance from which an observation is of a new landmark
known_ids: list[float] = []  # ids of the landmarks in the state, in the order of the state


def wrap(angle: float) -> float:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def predict(x: Array, P: Array, u: Array) -> tuple[Array, Array]:
    """Move the robot; landmarks do not move."""
    way, theta = u[0, 0] * DT, x[2, 0]
    c, s = np.cos(theta), np.sin(theta)
    A = np.eye(len(x))
    A[0, 2], A[1, 2] = -way * s, way * c
    B = np.zeros((len(x), 2))
    B[0, 0], B[1, 0], B[2, 1] = DT * c, DT * s, DT
    x[0:3] += np.array([[way * c], [way * s], [u[1, 0] * DT]])
    x[2, 0] = wrap(x[2, 0])
    return x, A @ P @ A.T + B @ Q @ B.T


def expect(x: Array, landmark: int) -> tuple[Array, Array]:
    """Return the predicted observation (2, 1) of a landmark and its Jacobian (2, 3+2n)."""
    at = 3 + 2 * landmark
    dx, dy = x[at : at + 2, 0] - x[0:2, 0]
    r2 = dx**2 + dy**2
    r = np.sqrt(r2)
    H = np.zeros((2, len(x)))
    H[:, 0:3] = [[-dx / r, -dy / r, 0.0], [dy / r2, -dx / r2, -1.0]]
    H[:, at : at + 2] = [[dx / r, dy / r], [-dy / r2, dx / r2]]
    return np.array([[r], [np.arctan2(dy, dx) - x[2, 0]]]), H


def innovation_of(x: Array, P: Array, yi: Array, landmark: int) -> tuple[Array, Array, Array]:
    """Return the innovation (2, 1), its covariance and the Jacobian."""
    expected, H = expect(x, landmark)
    innovation = yi[0:2].reshape(2, 1) - expected
    innovation[1, 0] = wrap(innovation[1, 0])
    return innovation, H @ P @ H.T + Py, H


def correct(x: Array, P: Array, yi: Array, landmark: int) -> tuple[Array, Array]:
    innovation, S, H = innovation_of(x, P, yi, landmark)
    K = P @ H.T @ np.linalg.inv(S)
    x = x + K @ innovation
    x[2, 0] = wrap(x[2, 0])
    P = P - K @ S @ K.T
    return x, (P + P.T) / 2


def add_landmark(x: Array, P: Array, yi: Array) -> tuple[Array, Array]:
    """Add a landmark at the observed position; its error is correlated with that of the robot."""
    r, phi = yi[0], x[2, 0] + yi[1]
    c, s = np.cos(phi), np.sin(phi)
    Jr = np.array([[1.0, 0.0, -r * s], [0.0, 1.0, r * c]])
    Jy = np.array([[c, -r * s], [s, r * c]])
    cross = Jr @ P[0:3, :]
    corner = Jr @ P[0:3, 0:3] @ Jr.T + Jy @ Py @ Jy.T
    x = np.vstack([x, x[0:2] + np.array([[r * c], [r * s]])])
    return x, np.block([[P, cross.T], [cross, corner]])


def associate(x: Array, P: Array, yi: Array) -> int:
    """Return the number of the observed landmark, n for a new landmark."""
    count = (len(x) - 3) // 2
    if KNOWN_DATA_ASSOCIATION:
        if yi[2] not in known_ids:
            known_ids.append(yi[2])
        return known_ids.index(yi[2])
    distances = [M_DIST_TH] * (count + 1)
    for i in range(count):
        innovation, S, _ = innovation_of(x, P, yi, i)
        distances[i] = (innovation.T @ np.linalg.inv(S) @ innovation)[0, 0]
    return int(np.argmin(distances))


def ekf_slam(xEst: Array, PEst: Array, u: Array, y: Array) -> tuple[Array, Array]:
    """Take one step: predict with u, then correct with each observation in y, or add a new landmark."""
    xEst, PEst = predict(xEst, PEst, u)
    for yi in y:
        landmark = associate(xEst, PEst, yi)
        if landmark == (len(xEst) - 3) // 2:
            xEst, PEst = add_landmark(xEst, PEst, yi)
        else:
            xEst, PEst = correct(xEst, PEst, yi, landmark)
    return xEst, PEst
