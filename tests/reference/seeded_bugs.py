"""A textbook EKF with an optional bug, and the check of `slamgauge check` that must fail for each bug.

The correct filter is that of the exercise, with full matrices and one observation after another. The line that a bug
changes names the bug.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from slamgauge.arrays import Float
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import between, compose

# each bug and the check that must fail, alone
SEEDED = {
    "wrong sign in F": "prediction-jacobian",
    "missing term in F": "prediction-jacobian",
    "Q in the wrong frame": "odometry-noise-frame",
    "sigma for variance in Q": "odometry-noise-size",
    "Q scaled by the time step": "time-step",
    "no heading in J of a new landmark": "first-sight",
    "no cross-covariance of a new landmark": "cross-covariance",
    "H of the range not divided by it": "update-range",
    "wrong sign in H of the bearing": "update-bearing",
    "wrong sign of y in H of the pose": "standing-robot",
    "R not added": "measurement-noise",
    "no wrap of the innovation": "innovation-wrap",
    "no wrap of the heading": "heading-wrap",
    "atan for atan2": "landmarks-behind",
    "motion along the heading after the turn": "truth-recovered",
    "stale landmark index": "scan-order",
    "ids taken for places": "permuted-ids",
    "landmarks forgotten": "long-unseen",
    "shifted by a step": "no-future",
    "start with no uncertainty": "prior-respected",
    "inverse of the prior": "zero-prior",
    "gain in single precision": "sound-covariances",
}


@dataclass
class TextbookEkf:
    """State of the filter: robot, then landmarks in the order of their first observation.

    Attributes:
        x: (3+2L,) mean.
        P: (3+2L, 3+2L) covariance.
        bug: name of the bug, empty for the correct filter.
        slots: index of each id's first coordinate in the state.
        last_seen: step of the last observation of each id.
    """

    x: Float
    P: Float
    bug: str = ""
    slots: dict[int, int] = field(default_factory=dict[int, int])
    last_seen: dict[int, int] = field(default_factory=dict[int, int])

    def predict(self, increment: Float, Q: Float) -> None:
        """Move the robot by an increment with covariance Q, both in the body frame."""
        (d, _, turn), heading = increment, self.x[2]
        direction = heading + turn if self.bug == "motion along the heading after the turn" else heading
        dx, dy = d * np.cos(direction), d * np.sin(direction)
        F, G = np.eye(len(self.x)), np.zeros((len(self.x), 3))
        F[0, 2], F[1, 2] = -dy, dx
        if self.bug == "wrong sign in F":
            F[0, 2] = dy
        if self.bug == "missing term in F":
            F[1, 2] = 0.0
        c, s = np.cos(heading), np.sin(heading)
        G[:3, :3] = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
        if self.bug == "Q in the wrong frame":
            G[:3, :3] = np.eye(3)
        if self.bug == "sigma for variance in Q":
            Q = np.sqrt(Q)
        self.x[:3] += [dx, dy, turn]
        if self.bug != "no wrap of the heading":
            self.x[2] = wrap_once(self.x[2])
        self.P = F @ self.P @ F.T + G @ Q @ G.T

    def update(self, slot: int, z: Float, R: Float) -> None:
        """Correct with range and bearing of the landmark at this index of the state."""
        dx, dy = self.x[slot : slot + 2] - self.x[:2]
        r = np.hypot(dx, dy)
        direction = np.arctan(dy / dx) if self.bug == "atan for atan2" else np.arctan2(dy, dx)
        of_landmark = np.array([[dx / r, dy / r], [-dy / r**2, dx / r**2]])
        if self.bug == "H of the range not divided by it":
            of_landmark[0] *= r
        if self.bug == "wrong sign in H of the bearing":
            of_landmark[1] *= -1.0
        H = np.zeros((2, len(self.x)))
        H[:, :2], H[1, 2], H[:, slot : slot + 2] = -of_landmark, -1.0, of_landmark
        if self.bug == "wrong sign of y in H of the pose":
            H[0, 1] *= -1.0
        v = z - [r, direction - self.x[2]]
        if self.bug != "no wrap of the innovation":
            v[1] = wrap_once(v[1])
        S = H @ self.P @ H.T + (0.0 if self.bug == "R not added" else R)
        K = self.P @ H.T @ np.linalg.inv(S)
        if self.bug == "gain in single precision":
            K = K.astype(np.float32).astype(np.float64)
        self.x = self.x + K @ v
        P = (np.eye(len(self.x)) - K @ H) @ self.P
        self.P = (P + P.T) / 2

    def add(self, z: Float, R: Float) -> int:
        """Append the landmark of a first observation, and return its index in the state."""
        r, direction = z[0], self.x[2] + z[1]
        c, s = np.cos(direction), np.sin(direction)
        n = len(self.x)
        Jr, Jz = np.zeros((2, n)), np.array([[c, -r * s], [s, r * c]])
        Jr[:, :3] = [[1.0, 0.0, -r * s], [0.0, 1.0, r * c]]
        if self.bug == "no heading in J of a new landmark":
            Jr[:, 2] = 0.0
        cross = Jr @ self.P
        own = Jr @ self.P @ Jr.T + Jz @ R @ Jz.T
        if self.bug == "no cross-covariance of a new landmark":
            cross[:] = 0.0
        self.x = np.append(self.x, self.x[:2] + r * np.array([c, s]))
        self.P = np.block([[self.P, cross.T], [cross, own]])
        return n

    def process(self, step: int, name: int, z: Float, R: Float, stale: int | None) -> int:
        """Process an observation of a mapped or a new landmark, and return the index in the state."""
        long_ago = step - self.last_seen.get(name, step) > 20
        if name not in self.slots or (self.bug == "landmarks forgotten" and long_ago):
            self.slots[name] = self.add(z, R)
        else:
            slot = self.slots[name]
            if self.bug == "stale landmark index" and stale is not None:
                slot = stale
            if self.bug == "ids taken for places":
                slot = 3 + 2 * name
            self.update(slot, z, R)
        self.last_seen[name] = step
        return self.slots[name]

    def landmark_blocks(self) -> tuple[Float, Float]:
        """Return positions (L, 2) and covariances (L, 2, 2) in the order of `slots`."""
        places = [slice(slot, slot + 2) for slot in self.slots.values()]
        positions = np.array([self.x[place] for place in places]).reshape(-1, 2)
        return positions, np.array([self.P[place, place] for place in places]).reshape(-1, 2, 2)


def wrap_once(angle: float) -> float:
    """Return an angle between -3 pi and 3 pi wrapped to [-pi, pi]."""
    return angle - 2.0 * np.pi * np.sign(angle) if abs(angle) > np.pi else angle


def seeded_ekf(recording: Recording, bug: str = "") -> Estimate:
    """Run the textbook EKF with this bug, a key of `SEEDED`, or without a bug if empty."""
    assert recording.landmark is not None
    ekf = TextbookEkf(recording.prior_mean.copy(), recording.prior_cov, bug)
    if bug == "inverse of the prior":
        ekf.P = np.linalg.inv(np.linalg.inv(ekf.P)).astype(np.float64)
    if bug == "start with no uncertainty":
        ekf.P = np.zeros((3, 3))
    poses, covs = [], []
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            dt = recording.stamps[k] - recording.stamps[k - 1]
            Q = recording.odometry_cov[k - 1] * (dt if bug == "Q scaled by the time step" else 1.0)
            ekf.predict(recording.odometry[k - 1], Q)
        assert scan.landmark is not None
        stale = None
        for name, z, R in zip(scan.landmark.tolist(), scan.value, scan.cov, strict=True):
            slot = ekf.process(k, name, z, R, stale)
            stale = slot if stale is None else stale
        poses.append(ekf.x[:3].copy())
        covs.append(ekf.P[:3, :3])
    if bug == "shifted by a step":
        back = between(recording.odometry, np.zeros(3))
        poses[:-1] = [compose(pose, step) for pose, step in zip(poses[1:], back, strict=True)]
    positions, landmark_covs = ekf.landmark_blocks()
    return Estimate("filtered", np.array(poses), np.array(covs), np.array([*ekf.slots]), positions, landmark_covs)
