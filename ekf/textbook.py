"""EKF-SLAM of the exercise (TP4 of ENSTA's ROB312): equation (1.1), whose six lines are numbered here.

State x = [robot x, y, heading; x, y of landmark 1; x, y of landmark 2; ...] and covariance P, world frame, m and rad.
R is the rotation by the heading, J the quarter turn (dR/d(heading) = J R). A landmark l is at delta = R' (l - p) in the
frame of a robot at p; `slamgauge.sensors` has the observation h(delta) of each sensor, and A = dh/d(delta).
The filter `ekf` gives the same estimate and is faster (tests/ekf/test_textbook.py).

`python ekf/textbook.py` simulates a scenario, runs this filter and draws the result.
"""

from __future__ import annotations

from time import perf_counter
from typing import NamedTuple

import numpy as np

from slamgauge import sensors
from slamgauge.arrays import Float, Int
from slamgauge.ekf.settings import NEAREST_NEIGHBOUR, Association
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import compose, rotation, wrap
from slamgauge.validation import require_type

J = np.array([[0.0, -1.0], [1.0, 0.0]])


class Belief(NamedTuple):
    """The state of the filter: a Gaussian of robot and landmarks."""

    x: Float  # (3 + 2L,) mean
    P: Float  # (3 + 2L, 3 + 2L) covariance
    ids: tuple[int, ...]  # (L,) landmarks in the order of x


class Linearised(NamedTuple):
    """Observations (m, d) of mapped landmarks, linearised at a state."""

    innovation: Float  # (m, d) Y - Y*
    jacobian: Float  # (m, d, 5) the columns of H that are not zero: robot x, y, heading, landmark x, y
    columns: Int  # (m, 5) entries of the state that belong to these columns
    noise: Float  # (m, d, d) P_Y


class Step(NamedTuple):
    """The belief after a scan of m observations."""

    belief: Belief
    landmarks: list[int]  # (m,) id of each observation
    nis: float
    dof: int  # degrees of freedom of the NIS


def textbook_ekf(recording: Recording, association: Association | None = None) -> Estimate:
    """Run the EKF-SLAM of the exercise.

    Args:
        recording: range-bearing or position sensor, with or without landmark ids.
        association: nearest neighbour with its gate (M_DIST_TH of the exercise), for a recording without ids.

    Raises:
        UserError: a bearing-only recording, or an association that the exercise does not have.
    """
    require_type("recording", recording, Recording)
    association = association or NEAREST_NEIGHBOUR
    if not sensors.SENSORS[recording.sensor].places_landmarks:
        raise UserError("sensor: textbook-ekf has no bearing-only landmarks; use ekf, which starts them as rays (FIS)")
    if association.method != "nearest-neighbour" or association.map_management:
        raise UserError("association: textbook-ekf has the nearest neighbour without map management only; use ekf")
    belief = Belief(recording.prior_mean, recording.prior_cov, ())
    associated, rows = list[int](), []
    for k, scan in enumerate(recording.scans()):
        start = perf_counter()
        if k > 0:
            belief = predict(belief, recording.odometry[k - 1], recording.odometry_cov[k - 1])
        if recording.landmark is None:
            step = update_by_nearest_neighbour(recording.sensor, belief, scan, association.gate)
        else:
            step = update_by_ids(recording.sensor, belief, scan)
        belief = step.belief
        associated += step.landmarks
        rows.append((belief.x[:3].copy(), belief.P[:3, :3].copy(), step.nis, step.dof, perf_counter() - start))
    poses, pose_covs, nis, dof, seconds = (np.array(each) for each in zip(*rows, strict=True))
    x, P, ids = belief
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


def predict(belief: Belief, u: Float, Q: Float) -> Belief:
    """Move the robot by the body-frame increment u (3,) with covariance Q (3, 3); landmarks do not move."""
    F, G = motion_jacobians(belief.x, u)
    x, P = belief.x.copy(), belief.P.copy()
    x[:3] = compose(x[:3], u)  # (1.1), line 1: X* = f(X, u)
    P[:3, :] = F @ P[:3, :]  # (1.1), line 2: P* = F P F' + G Q G', where the exercise writes A and B
    P[:, :3] = P[:, :3] @ F.T
    P[:3, :3] += G @ Q @ G.T
    return Belief(x, P, belief.ids)


def motion_jacobians(x: Float, u: Float) -> tuple[Float, Float]:
    """Return F = df/d(robot) and G = df/du, (3, 3) each."""
    F, G = np.eye(3), np.eye(3)
    F[:2, 2] = J @ rotation(x[2]) @ u[:2]
    G[:2, :2] = rotation(x[2])
    return F, G


def update_by_ids(sensor: str, belief: Belief, scan: Observations) -> Step:
    """Update with all observations of mapped landmarks at once, then map the new ones in observation order."""
    landmarks, ids = np.asarray(scan.landmark).tolist(), belief.ids
    mapped = [i for i, each in enumerate(landmarks) if each in ids]
    new = [i for i, each in enumerate(landmarks) if each not in ids and each not in landmarks[:i]]
    belief, nis, dof = update_mapped(sensor, belief, scan, mapped)
    for i in new:
        belief = augment(sensor, belief, landmarks[i], scan.value[i], scan.cov[i])
    again = sorted({*range(len(landmarks))} - {*mapped, *new})  # rare: further observations of a new landmark
    belief, nis_again, dof_again = update_mapped(sensor, belief, scan, again)
    return Step(belief, landmarks, nis + nis_again, dof + dof_again)


def update_mapped(sensor: str, belief: Belief, scan: Observations, rows: list[int]) -> tuple[Belief, float, int]:
    """Update with the observations `rows` of a scan, all of mapped landmarks; see `update`."""
    if not rows:
        return belief, 0.0, 0
    slots = np.array([belief.ids.index(each) for each in np.asarray(scan.landmark)[rows].tolist()])
    seen = linearise(sensor, belief.x, slots, scan.value[rows], scan.cov[rows])
    return update(belief, *stack(seen, len(belief.x)))


def update_by_nearest_neighbour(sensor: str, belief: Belief, scan: Observations, gate: float) -> Step:
    """Take one observation after the other: update with its nearest landmark in the gate, else map a new landmark."""
    landmarks, nis, dof = list[int](), 0.0, 0
    for z, noise in zip(scan.value, scan.cov, strict=True):
        new = len(belief.ids)
        seen = linearise(sensor, belief.x, np.arange(new), z[None], np.repeat(noise[None], new, axis=0))
        distances = squared_distances(belief.P, seen)
        nearest = int(distances.argmin()) if distances.min(initial=np.inf) <= gate else new
        if nearest == new:
            belief = augment(sensor, belief, new, z, noise)
        else:
            its = linearise(sensor, belief.x, np.array([nearest]), z[None], noise[None])
            belief, its_nis, its_dof = update(belief, *stack(its, len(belief.x)))
            nis, dof = nis + its_nis, dof + its_dof
        landmarks.append(nearest)
    return Step(belief, landmarks, nis, dof)


def linearise(sensor: str, x: Float, slots: Int, z: Float, noise: Float, x_jac: Float | None = None) -> Linearised:
    """Compare observations z (m, d), covariances `noise` (m, d, d), with predictions for landmarks number `slots` (m,).

    The bearing of a landmark within a centimetre carries no information: its innovation and its row of H are zero.
    H is taken at x; filters with first-estimates Jacobians pass another state, `x_jac`.
    """
    x_jac = x if x_jac is None else x_jac
    now, offset = (at[3:].reshape(-1, 2)[slots] - at[:2] for at in (x, x_jac))  # l - p
    Y = sensors.predict(sensor, now @ rotation(x[2]))  # (1.1), line 3: Y* = h(X*), with delta = R' (l - p)
    A = sensors.jacobian(sensor, offset @ rotation(x_jac[2]))
    H_l = A @ rotation(x_jac[2]).T
    H = np.concatenate([-H_l, -H_l @ (offset @ J.T)[:, :, None], H_l], axis=2)  # A R' [-I, -J (l - p), I]
    innovation = np.where(A.any(axis=2), sensors.innovation(sensor, z, Y), 0.0)
    columns = np.column_stack([np.tile([0, 1, 2], (len(slots), 1)), 3 + 2 * slots, 4 + 2 * slots])
    return Linearised(innovation, H, columns, noise)


def squared_distances(P: Float, seen: Linearised) -> Float:
    """Return the squared Mahalanobis distance (m,) v' S^-1 v of each observation."""
    v, H, c, noise = seen
    S = H @ P[c[:, :, None], c[:, None, :]] @ H.swapaxes(1, 2) + noise
    return np.einsum("mi,mij,mj->m", v, np.linalg.inv(S), v)


def stack(seen: Linearised, size: int) -> tuple[Float, Float, Float]:
    """Return Y - Y* (m d,), H (m d, size) and P_Y (m d, m d) of all observations."""
    m, d = seen.innovation.shape
    H, P_Y = np.zeros((m * d, size)), np.zeros((m * d, m * d))
    for i in range(m):
        rows = slice(i * d, (i + 1) * d)
        H[rows, seen.columns[i]] = seen.jacobian[i]
        P_Y[rows, rows] = seen.noise[i]
    return seen.innovation.ravel(), H, P_Y


def update(belief: Belief, v: Float, H: Float, P_Y: Float) -> tuple[Belief, float, int]:
    """Update with v = Y - Y* (r,), H (r, n) and P_Y (r, r); also return the NIS and its degrees of freedom."""
    x, P, ids = belief
    used = H.any(axis=1)  # without rows that carry no information
    v, H, P_Y = v[used], H[used], P_Y[used][:, used]
    S_inverse = np.linalg.inv(H @ P @ H.T + P_Y)
    K = P @ H.T @ S_inverse  # (1.1), line 4: K = P* H' (H P* H' + P_Y)^-1
    x = x + K @ v  # (1.1), line 5: X = X* + K (Y - Y*)
    x[2] = wrap(x[2])
    P = P - K @ (H @ P)  # (1.1), line 6: P = P* - K H P*
    return Belief(x, P, ids), float(v @ S_inverse @ v), len(v)


def augment(sensor: str, belief: Belief, landmark: int, z: Float, noise: Float) -> Belief:
    """Append a new landmark, observed at z (d,), to the state (section 1.1 of the exercise)."""
    x, P, ids = belief
    position, J_r, J_y = locate(sensor, x[:3], z)
    P_lx = J_r @ P[:3]
    P_ll = J_r @ P[:3, :3] @ J_r.T + J_y @ noise @ J_y.T
    return Belief(np.concatenate([x, position]), np.block([[P, P_lx.T], [P_lx, P_ll]]), (*ids, landmark))


def locate(sensor: str, pose: Float, z: Float) -> tuple[Float, Float, Float]:
    """Return the landmark l = p + R delta(z), and its Jacobians J_r (2, 3) by the pose and J_y (2, d) by z."""
    offset = rotation(pose[2]) @ sensors.inverse(sensor, z)
    J_r = np.column_stack([np.eye(2), J @ offset])
    return pose[:2] + offset, J_r, rotation(pose[2]) @ sensors.inverse_jacobian(sensor, z)


if __name__ == "__main__":
    from pathlib import Path

    from slamgauge import load_scenario, save_figure, simulate

    truth, recording = simulate(load_scenario("q1-long-dense"), seed=0)
    folder = Path("results/textbook")
    folder.mkdir(parents=True, exist_ok=True)
    save_figure(folder, truth, recording, {"textbook-ekf": textbook_ekf(recording)}, "q1-long-dense, seed 0")
    print(f"Map and errors: {folder / 'figure.png'}")
