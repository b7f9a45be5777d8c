"""EKF-SLAM of the exercise (TP4 of ENSTA's ROB312): equation (1.1), whose six lines are numbered here.

State x = [robot x, y, heading; x, y of landmark 1; x, y of landmark 2; ...] and covariance P, world frame, m and rad.
R is the rotation by the heading, J the quarter turn (dR/d(heading) = J R). A landmark l is at delta = R' (l - p) in the
frame of a robot at p; `slamgauge.sensors` has the observation h(delta) of each sensor, and A = dh/d(delta).
The filter `ekf` gives the same estimate and is faster (tests/ekf/test_textbook.py).
"""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from slamgauge import sensors
from slamgauge.arrays import Float, Int
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import compose, rotation, wrap
from slamgauge.validation import require_type

if TYPE_CHECKING:
    from slamgauge.ekf.settings import Association

J = np.array([[0.0, -1.0], [1.0, 0.0]])
GATE = 9.0  # M_DIST_TH of the exercise: largest squared Mahalanobis distance of an observation and its landmark
Step = tuple[Float, Float, list[int], float, int]  # x, P, ids of the observations, NIS, its degrees of freedom


class Linearised(NamedTuple):
    """Observations (m, d) of mapped landmarks, linearised at a state."""

    innovation: Float  # (m, d) Y - Y*
    jacobian: Float  # (m, d, 5) the columns of H that are not zero: robot x, y, heading, landmark x, y
    columns: Int  # (m, 5) entries of the state that belong to these columns
    noise: Float  # (m, d, d) P_Y


def textbook_ekf(recording: Recording, association: Association | None = None) -> Estimate:
    """Run the EKF-SLAM of the exercise.

    Args:
        recording: range-bearing or position sensor, with or without landmark ids.
        association: nearest neighbour with its gate, for a recording without ids; the default gate is `GATE`.

    Raises:
        UserError: a bearing-only recording, or an association that the exercise does not have.
    """
    require_type("recording", recording, Recording)
    gate = _require_exercise(recording, association)
    x, P, ids = recording.prior_mean, recording.prior_cov, list[int]()
    associated, rows = list[int](), []
    for step, scan in enumerate(recording.scans()):
        start = perf_counter()
        if step > 0:
            x, P = predict(x, P, recording.odometry[step - 1], recording.odometry_cov[step - 1])
        if recording.landmark is None:
            x, P, landmarks, nis, dof = update_by_nearest_neighbour(recording.sensor, x, P, scan, ids, gate)
        else:
            x, P, landmarks, nis, dof = update_by_ids(recording.sensor, x, P, scan, ids)
        associated += landmarks
        rows.append((x[:3].copy(), P[:3, :3].copy(), nis, dof, perf_counter() - start))
    poses, pose_covs, nis, dof, seconds = (np.array(each) for each in zip(*rows, strict=True))
    return Estimate(
        kind="filtered",
        poses=poses,
        pose_covs=pose_covs,
        landmark_ids=np.array(ids, dtype=np.int64),
        landmarks=x[3:].reshape(-1, 2),
        landmark_covs=np.array([P[i : i + 2, i : i + 2] for i in range(3, len(x), 2)]).reshape(-1, 2, 2),
        association=np.array(associated, dtype=np.int64),
        nis=nis,
        nis_dof=dof,
        seconds=seconds,
    )


def predict(x: Float, P: Float, u: Float, Q: Float) -> tuple[Float, Float]:
    """Move the robot by the body-frame increment u (3,) with covariance Q (3, 3); landmarks do not move."""
    F, G = motion_jacobians(x, u)
    x, P = x.copy(), P.copy()
    x[:3] = compose(x[:3], u)  # (1.1), line 1: X* = f(X, u)
    P[:3, :] = F @ P[:3, :]  # (1.1), line 2: P* = F P F' + G Q G', where the exercise writes A and B
    P[:, :3] = P[:, :3] @ F.T
    P[:3, :3] += G @ Q @ G.T
    return x, P


def motion_jacobians(x: Float, u: Float) -> tuple[Float, Float]:
    """Return F = df/d(robot) and G = df/du, (3, 3) each."""
    F, G = np.eye(3), np.eye(3)
    F[:2, 2] = J @ rotation(x[2]) @ u[:2]
    G[:2, :2] = rotation(x[2])
    return F, G


def update_by_ids(sensor: str, x: Float, P: Float, scan: Observations, ids: list[int]) -> Step:
    """Update with all observations of mapped landmarks `ids` at once, then map the new ones in observation order."""
    landmark, nis, dof = np.asarray(scan.landmark).tolist(), 0.0, 0
    rows = [*range(len(landmark))]
    while rows:
        mapped, others = [i for i in rows if landmark[i] in ids], [i for i in rows if landmark[i] not in ids]
        if mapped:
            slots = np.array([ids.index(landmark[i]) for i in mapped])
            x, P, added, its_dof = update(x, P, linearise(sensor, x, slots, scan.value[mapped], scan.cov[mapped]))
            nis, dof = nis + added, dof + its_dof
        rows = []
        for i in others:
            if landmark[i] in ids:
                rows.append(i)  # a second observation of a landmark that is new in this scan updates next
            else:
                x, P = augment(sensor, x, P, scan.value[i], scan.cov[i])
                ids.append(landmark[i])
    return x, P, landmark, nis, dof


def update_by_nearest_neighbour(
    sensor: str, x: Float, P: Float, scan: Observations, ids: list[int], gate: float
) -> Step:
    """Take one observation after the other: update with its nearest landmark in the gate, else map a new landmark."""
    association, nis, dof = list[int](), 0.0, 0
    for z, noise in zip(scan.value, scan.cov, strict=True):
        all_noise = np.repeat(noise[None], len(ids), axis=0)
        distances = squared_distances(P, linearise(sensor, x, np.arange(len(ids)), z[None], all_noise))
        if distances.min(initial=np.inf) <= gate:
            nearest = int(distances.argmin())
            x, P, added, its_dof = update(x, P, linearise(sensor, x, np.array([nearest]), z[None], noise[None]))
            nis, dof = nis + added, dof + its_dof
        else:
            nearest = len(ids)
            x, P = augment(sensor, x, P, z, noise)
            ids.append(nearest)
        association.append(nearest)
    return x, P, association, nis, dof


def linearise(sensor: str, x: Float, slots: Int, z: Float, noise: Float) -> Linearised:
    """Compare observations z (m, d), covariances `noise` (m, d, d), with predictions for landmarks number `slots` (m,).

    The bearing of a landmark within a centimetre carries no information: its innovation and its row of H are zero.
    """
    offset = x[3:].reshape(-1, 2)[slots] - x[:2]  # l - p
    delta = offset @ rotation(x[2])  # R' (l - p)
    A = sensors.jacobian(sensor, delta)
    Y = sensors.predict(sensor, delta)  # (1.1), line 3: Y* = h(X*)
    innovation = np.where(A.any(axis=2), sensors.innovation(sensor, z, Y), 0.0)
    H_l = A @ rotation(x[2]).T
    H = np.concatenate([-H_l, -H_l @ (offset @ J.T)[:, :, None], H_l], axis=2)  # A R' [-I, -J (l - p), I]
    columns = np.column_stack([np.tile([0, 1, 2], (len(slots), 1)), 3 + 2 * slots, 4 + 2 * slots])
    return Linearised(innovation, H, columns, noise)


def squared_distances(P: Float, seen: Linearised) -> Float:
    """Return the squared Mahalanobis distance (m,) v' S^-1 v of each observation."""
    v, H, c, noise = seen
    S = H @ P[c[:, :, None], c[:, None, :]] @ H.swapaxes(1, 2) + noise
    return np.einsum("mi,mij,mj->m", v, np.linalg.inv(S), v)


def update(x: Float, P: Float, seen: Linearised) -> tuple[Float, Float, float, int]:
    """Update with all given observations at once; return x, P, NIS and its degrees of freedom."""
    m, d = seen.innovation.shape
    H, P_Y = np.zeros((m, d, len(x))), np.zeros((m, d, m, d))
    for i in range(m):
        H[i][:, seen.columns[i]], P_Y[i, :, i] = seen.jacobian[i], seen.noise[i]
    rows = H.any(axis=2).ravel()  # without those that carry no information
    H, v, P_Y = H.reshape(m * d, -1)[rows], seen.innovation.ravel()[rows], P_Y.reshape(m * d, -1)[rows][:, rows]
    S_inverse = np.linalg.inv(H @ P @ H.T + P_Y)
    K = P @ H.T @ S_inverse  # (1.1), line 4: K = P* H' (H P* H' + P_Y)^-1
    x = x + K @ v  # (1.1), line 5: X = X* + K (Y - Y*)
    x[2] = wrap(x[2])
    P = P - K @ (H @ P)  # (1.1), line 6: P = P* - K H P*
    return x, P, float(v @ S_inverse @ v), len(v)


def augment(sensor: str, x: Float, P: Float, z: Float, noise: Float) -> tuple[Float, Float]:
    """Append a new landmark, observed at z (d,), to the state (section 1.1 of the exercise)."""
    landmark, J_r, J_y = locate(sensor, x[:3], z)
    P_lx = J_r @ P[:3]
    P_ll = J_r @ P[:3, :3] @ J_r.T + J_y @ noise @ J_y.T
    return np.concatenate([x, landmark]), np.block([[P, P_lx.T], [P_lx, P_ll]])


def locate(sensor: str, pose: Float, z: Float) -> tuple[Float, Float, Float]:
    """Return the landmark l = p + R delta(z), and its Jacobians J_r (2, 3) by the pose and J_y (2, d) by z."""
    offset = rotation(pose[2]) @ sensors.inverse(sensor, z)
    J_r = np.column_stack([np.eye(2), J @ offset])
    return pose[:2] + offset, J_r, rotation(pose[2]) @ sensors.inverse_jacobian(sensor, z)


def _require_exercise(recording: Recording, association: Association | None) -> float:
    """Refuse what the exercise's filter does not have; return the gate."""
    if not sensors.SENSORS[recording.sensor].places_landmarks:
        raise UserError("sensor: textbook-ekf has no bearing-only landmarks; use ekf, which starts them as rays (FIS)")
    if association and (association.method != "nearest-neighbour" or association.map_management):
        raise UserError("association: textbook-ekf has the nearest neighbour without map management only; use ekf")
    return association.gate if association else GATE
