"""EKF-SLAM of the exercise, equation by equation (TP4 of ENSTA's ROB312; equation 1.1, its six lines numbered here).

State x = [robot x, y, heading; x, y of landmark 1; x, y of landmark 2; ...], covariance P, world frame, m and rad.
`J` is the quarter turn: d/dt R(t) = J R(t). A landmark is at delta = R(heading)' (l - p) in the robot's frame;
`slamgauge.sensors` has what a sensor measures of it, z = h(delta), and A = dz/d(delta).
The filter `ekf` computes the same with compiled kernels; a test compares the two.
"""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import block_diag

import slamgauge.sensors as sensors
from slamgauge.arrays import Float, Int
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import compose, rotation, wrap

if TYPE_CHECKING:
    from slamgauge.ekf.settings.association import Association

J = np.array([[0.0, -1.0], [1.0, 0.0]])
GATE = 9.0  # M_DIST_TH of the exercise: largest squared Mahalanobis distance of an observation and its landmark


class Linearised(NamedTuple):
    """Observations (m, d) of mapped landmarks, linearised at a state."""

    innovation: Float  # (m, d) v = z - h(x), bearings wrapped
    jacobian: Float  # (m, d, 5) H by robot x, y, heading and landmark x, y; zero for all other landmarks
    noise: Float  # (m, d, d) covariance P_Y
    columns: Int  # (m, 5) entries of the state that these five are

    @property
    def dof(self) -> int:
        """Number of rows of H that carry information."""
        return int(self.jacobian.any(axis=2).sum())


def textbook_ekf(recording: Recording, association: Association | None = None) -> Estimate:
    """Run the exercise's EKF-SLAM.

    Args:
        recording: range-bearing or position sensor, with or without landmark ids.
        association: nearest neighbour and its gate, for a recording without ids; by default `GATE`.

    Raises:
        UserError: a bearing-only recording, or an association that the exercise does not have.
    """
    gate = _require_exercise(recording, association)
    x, P, ids = recording.prior_mean, recording.prior_cov, list[int]()
    poses, covs, associated, nis, dof, seconds = [], [], list[int](), [], [], []
    for step, scan in enumerate(recording.scans()):
        start = perf_counter()
        if step > 0:
            x, P = predict(x, P, recording.odometry[step - 1], recording.odometry_cov[step - 1])
        if scan.landmark is None:
            x, P, result = update_by_nearest_neighbour(recording.sensor, x, P, scan, gate)
            ids = [*range((len(x) - 3) // 2)]
        else:
            x, P, result = update_by_ids(recording.sensor, x, P, scan, ids)
        poses.append(x[:3])
        covs.append(P[:3, :3])
        associated += result.association
        nis.append(result.nis)
        dof.append(result.dof)
        seconds.append(perf_counter() - start)
    return Estimate(
        kind="filtered",
        poses=np.array(poses),
        pose_covs=np.array(covs),
        landmark_ids=np.array(ids, dtype=np.int64),
        landmarks=x[3:].reshape(-1, 2),
        landmark_covs=np.array([P[i : i + 2, i : i + 2] for i in range(3, len(x), 2)]).reshape(-1, 2, 2),
        association=np.array(associated, dtype=np.int64),
        nis=np.array(nis),
        nis_dof=np.array(dof),
        seconds=np.array(seconds),
    )


def predict(x: Float, P: Float, u: Float, Q: Float) -> tuple[Float, Float]:
    """Move the robot by the body-frame increment u (3,) with covariance Q (3, 3)."""
    F, G = motion_jacobians(x, u)
    x, P = x.copy(), P.copy()
    x[:3] = compose(x[:3], u)  # (1.1), line 1: X* = f(X, u)
    P[:3, :] = F @ P[:3, :]  # (1.1), line 2: P* = F P F' + G Q G', called A and B there; landmarks stay where they are
    P[:, :3] = P[:, :3] @ F.T
    P[:3, :3] += G @ Q @ G.T
    return x, P


def motion_jacobians(x: Float, u: Float) -> tuple[Float, Float]:
    """F (3, 3) = df/d(robot) and G (3, 3) = df/du at the increment u."""
    R = rotation(x[2])
    F, G = np.eye(3), np.eye(3)
    F[:2, 2] = J @ R @ u[:2]
    G[:2, :2] = R
    return F, G


def linearise(sensor: str, x: Float, slots: Int, z: Float, noise: Float) -> Linearised:
    """Compare observations z (m, d) of the landmarks in `slots` (m,) with their predictions.

    A landmark within a centimetre of the robot has no bearing: its row of H and its innovation are zero.
    """
    offset = x[3:].reshape(-1, 2)[slots] - x[:2]  # l - p
    R = rotation(x[2])
    delta = offset @ R
    A = sensors.jacobian(sensor, delta)
    predicted = sensors.predict(sensor, delta)  # (1.1), line 3: Y* = h(X*)
    B = A @ R.T
    turn = -B @ (offset @ J.T)[:, :, None]
    H = np.concatenate([-B, turn, B], axis=2)  # H = A R' [-I, -J (l - p), I]
    has_value = A.any(axis=2)
    v = np.where(has_value, sensors.innovation(sensor, z, predicted), 0.0)
    shared = has_value[:, :, None] & has_value[:, None, :] | np.eye(A.shape[1], dtype=bool)
    columns = np.column_stack([np.tile([0, 1, 2], (len(slots), 1)), 3 + 2 * slots, 4 + 2 * slots])
    return Linearised(v, H, np.where(shared, noise, 0.0), columns)


def update(x: Float, P: Float, seen: Linearised) -> tuple[Float, Float, float]:
    """Correct by all given observations at once; the third result is the normalised innovation squared."""
    m, d, _ = seen.jacobian.shape
    H = np.zeros((m, d, len(x)))
    np.put_along_axis(H, np.repeat(seen.columns[:, None], d, axis=1), seen.jacobian, axis=2)
    H, v = H.reshape(m * d, -1), seen.innovation.ravel()
    S_inverse = np.linalg.inv(H @ P @ H.T + block_diag(*seen.noise))
    K = P @ H.T @ S_inverse  # (1.1), line 4: K = P* H' (H P* H' + P_Y)^-1
    x = x + K @ v  # (1.1), line 5: X = X* + K (Y - Y*)
    x[2] = wrap(x[2])
    return x, P - K @ (H @ P), float(v @ S_inverse @ v)  # (1.1), line 6: P = P* - K H P*


def augment(sensor: str, x: Float, P: Float, z: Float, noise: Float) -> tuple[Float, Float]:
    """Append the landmark of an observation z (d,) to the state: l = p + R(heading) delta(z)."""
    landmark, J_r, J_y = locate(sensor, x[:3], z)
    across = J_r @ P[:3]
    P_ll = J_r @ P[:3, :3] @ J_r.T + J_y @ noise @ J_y.T
    return np.concatenate([x, landmark]), np.block([[P, across.T], [across, P_ll]])


def locate(sensor: str, pose: Float, z: Float) -> tuple[Float, Float, Float]:
    """Landmark position (2,) of an observation z (d,), and its Jacobians J_r (2, 3) by the pose, J_y (2, d) by z."""
    R = rotation(pose[2])
    offset = R @ sensors.inverse(sensor, z)
    J_r = np.column_stack([np.eye(2), J @ offset])
    return pose[:2] + offset, J_r, R @ sensors.inverse_jacobian(sensor, z)


class Result(NamedTuple):
    """Result of the observations of one step."""

    association: list[int]  # landmark id of each observation
    nis: float  # normalised innovation squared
    dof: int  # its degrees of freedom


def update_by_ids(sensor: str, x: Float, P: Float, scan: Observations, ids: list[int]) -> tuple[Float, Float, Result]:
    """Correct by all observations of mapped landmarks at once, then map new landmarks in the order of observation.

    `ids` are those of the mapped landmarks; new ones are appended. The second observation of a landmark that is new in
    this scan corrects afterwards.
    """
    landmark, nis, dof = scan.landmark.tolist(), 0.0, 0
    rows = [*range(len(landmark))]
    while rows:
        mapped = [i for i in rows if landmark[i] in ids]
        if mapped:
            slots = np.array([ids.index(landmark[i]) for i in mapped])
            seen = linearise(sensor, x, slots, scan.value[mapped], scan.cov[mapped])
            x, P, added = update(x, P, seen)
            nis, dof = nis + added, dof + seen.dof
        rows = [i for i in rows if i not in mapped]
        for i in [*rows]:
            if landmark[i] not in ids:
                x, P = augment(sensor, x, P, scan.value[i], scan.cov[i])
                ids.append(landmark[i])
                rows.remove(i)
    return x, P, Result(landmark, nis, dof)


def update_by_nearest_neighbour(
    sensor: str, x: Float, P: Float, scan: Observations, gate: float
) -> tuple[Float, Float, Result]:
    """Take observation by observation: the nearest landmark within the gate corrects at once, else a new one is mapped.

    Ids of landmarks are 0, 1, 2, ... in the order in which they are mapped.
    """
    associated, nis, dof = list[int](), 0.0, 0
    for z, noise in zip(scan.value, scan.cov, strict=True):
        every = np.arange((len(x) - 3) // 2)
        seen = linearise(sensor, x, every, z[None], noise[None])
        distances = squared_distances(P, seen)
        if len(every) and distances.min() <= gate:
            nearest = distances.argmin()
            seen = Linearised(*(each[[nearest]] for each in seen))
            x, P, added = update(x, P, seen)
            nis, dof = nis + added, dof + seen.dof
        else:
            nearest = len(every)
            x, P = augment(sensor, x, P, z, noise)
        associated.append(int(nearest))
    return x, P, Result(associated, nis, dof)


def squared_distances(P: Float, seen: Linearised) -> Float:
    """Squared Mahalanobis distances (m,) v' S^-1 v of observations, each by itself."""
    v, H, c = seen.innovation, seen.jacobian, seen.columns
    S = H @ P[c[:, :, None], c[:, None, :]] @ H.swapaxes(1, 2) + seen.noise  # as in (1.1), line 4
    return np.einsum("mi,mij,mj->m", v, np.linalg.inv(S), v)


def _require_exercise(recording: Recording, association: Association | None) -> float:
    """Refuse what the exercise's filter cannot use; return the gate."""
    if recording.sensor == "bearing":
        raise UserError(
            "sensor: the textbook EKF has no bearing-only landmarks; use `ekf`, which starts them as rays (FIS)"
        )
    if association is None:
        return GATE
    if association.method != "nearest-neighbour" or association.map_management is not None:
        raise UserError(
            f"association: the textbook EKF has no {association.method} with map management or joint tests; "
            "use Association(gate=...), or `ekf`"
        )
    return association.gate
