"""A synthetic bearing-only run: half a loop past three landmarks, each with a ray of four members."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from slamgauge.arrays import Float
from slamgauge.estimate import Estimate, MapHistory, RayLog
from slamgauge.recording import Recording
from slamgauge.se2 import chain, rotation
from slamgauge.truth import Truth

Fate = Literal["point", "ray", "lost"]

STEPS = 300
LANDMARKS = np.array([[6.0, 3.5], [2.5, 7.0], [13.0, 8.0]])
DISTANCES = np.array([1.43, 2.86, 5.71, 11.43])  # [m]
BIRTHS = (0, 5, 60)
AGES = (12, 30, 70)  # [steps] at which a ray loses a member; at the last one it ends
NOTED = np.unique(np.linspace(0, STEPS, 240).astype(int))
BEARING_SIGMA = np.radians(5.0)
Row = tuple[int, int, int, float, Float, Float]  # step, landmark, member, weight, position, covariance


def half_loop() -> tuple[Truth, Recording]:
    """Simulate 30 s at 1 m/s and 0.1 rad/s, with observations of landmarks within 10 m from the birth of their ray."""
    odometry = np.tile([0.1, 0.0, 0.01], (STEPS, 1))
    poses = chain(np.zeros(3), odometry)
    near = np.linalg.norm(poses[:, None, :2] - LANDMARKS, axis=2) < 10
    near &= np.arange(STEPS + 1)[:, None] >= BIRTHS
    steps, ids = np.nonzero(near)
    directions = LANDMARKS[ids] - poses[steps, :2]
    recording = Recording(
        stamps=np.linspace(0, 30, STEPS + 1),
        prior_mean=np.zeros(3),
        prior_cov=np.zeros((3, 3)),
        odometry=odometry,
        odometry_cov=np.tile(1e-4 * np.eye(3), (STEPS, 1, 1)),
        sensor="bearing",
        observation_step=steps,
        observation=(np.arctan2(directions[:, 1], directions[:, 0]) - poses[steps, 2])[:, None],
        observation_cov=np.full((len(steps), 1, 1), BEARING_SIGMA**2),
        landmark=ids,
    )
    return Truth(poses, np.arange(3), LANDMARKS, ids), recording


def estimate_with_rays(fates: Sequence[Fate] = ("point", "point", "point")) -> Estimate:
    """Return an estimate that drifts away from `half_loop`; `fates` gives the end of each ray."""
    truth, _ = half_loop()
    assert truth.poses is not None
    drift = np.linspace(0, 1, STEPS + 1)[:, None]
    poses = truth.poses + drift * [0.5, -0.4, 0.05]
    ages = np.arange(STEPS + 1) - np.array(BIRTHS[: len(fates)])[:, None]  # age of each ray at each step
    has_ended = (ages >= AGES[-1]) & (np.array(fates)[:, None] != "ray")
    members = np.where((ages < 0) | has_ended, 0, 4 - sum((ages >= age).astype(int) for age in AGES[:2]))
    rows: list[Row] = []
    for step in NOTED.tolist():
        for landmark, fate in enumerate(fates):
            if has_ended[landmark, step] and fate == "point":
                rows.append((step, landmark, -1, 1.0, LANDMARKS[landmark] + 0.2, 0.04 * np.eye(2)))
            rows += _ray(step, landmark, members[landmark, step], poses)
    mapped = [i for i, fate in enumerate(fates) if fate == "point"]
    return Estimate(
        kind="filtered",
        poses=poses,
        pose_covs=drift[:, :, None] * np.diag([0.09, 0.04, 0.004]),
        landmark_ids=np.array(mapped),
        landmarks=LANDMARKS[mapped] + 0.2,
        landmark_covs=np.tile(0.04 * np.eye(2), (len(mapped), 1, 1)),
        rays=RayLog(
            landmark=np.arange(len(fates)),
            birth=np.array(BIRTHS[: len(fates)]),
            end=np.array([-1 if fate == "ray" else BIRTHS[i] + AGES[-1] for i, fate in enumerate(fates)]),
            survivor=np.array([2 if fate == "point" else -1 for fate in fates]),
            distances=np.tile(DISTANCES, (len(fates), 1)),
            members=members.sum(axis=0),
        ),
        history=MapHistory(*(np.array(column) for column in zip(*rows, strict=True))),
    )


def _ray(step: int, landmark: int, members: int, poses: Float) -> list[Row]:
    """Return the rows of a ray with this number of members, the farthest of the four distances."""
    start, left = poses[BIRTHS[landmark]], range(4 - members, 4)
    offset = LANDMARKS[landmark] - start[:2]
    along = rotation(np.arctan2(offset[1], offset[0]) + 0.05)
    rows: list[Row] = []
    for member in left:
        distance, weight = DISTANCES[member], (member + 1) / sum(each + 1 for each in left)
        spread = np.diag([0.3 * distance, BEARING_SIGMA * distance]) ** 2
        rows.append((step, landmark, member, weight, start[:2] + distance * along[:, 0], along @ spread @ along.T))
    return rows
