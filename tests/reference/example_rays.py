"""A synthetic bearing-only run: half a loop past three landmarks, each with a ray of four members."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
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


class Row(NamedTuple):
    """A row of a `MapHistory`."""

    step: int
    landmark: int
    member: int
    weight: float
    position: Float
    cov: Float


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
    rows = [row for i, fate in enumerate(fates) for row in _life(i, fate, poses)]
    rows.sort(key=lambda row: (row.step, row.landmark))
    ends = [-1 if fate == "ray" else BIRTHS[i] + AGES[-1] for i, fate in enumerate(fates)]
    survivors = [_nearest(i, poses) if fate == "point" else -1 for i, fate in enumerate(fates)]
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
            end=np.array(ends),
            survivor=np.array(survivors),
            distances=np.tile(DISTANCES, (len(fates), 1)),
            members=np.sum([_members(i, fate) for i, fate in enumerate(fates)], axis=0),
        ),
        history=MapHistory(*(np.array(column) for column in zip(*rows, strict=True))),
    )


def _members(landmark: int, fate: Fate) -> Int:
    """Return the number of members of the landmark's ray after each step."""
    age = np.arange(STEPS + 1) - BIRTHS[landmark]
    left = 4 - np.sum([age >= each for each in AGES[:2]], axis=0)
    return np.where((age < 0) | ((age >= AGES[-1]) & (fate != "ray")), 0, left)


def _nearest(landmark: int, poses: Float) -> int:
    """Return the member nearest to the true landmark."""
    distance = np.linalg.norm(LANDMARKS[landmark] - poses[BIRTHS[landmark], :2])
    return int(np.argmin(np.abs(DISTANCES - distance)))


def _life(landmark: int, fate: Fate, poses: Float) -> list[Row]:
    """Return the rows of one landmark: a ray that loses its least likely members, then a point that converges."""
    birth = BIRTHS[landmark]
    offset = LANDMARKS[landmark] - poses[birth, :2]
    bearing = np.arctan2(offset[1], offset[0]) + 0.05
    along = rotation(bearing)
    best = _nearest(landmark, poses)
    order = sorted(range(4), key=lambda member: -abs(member - best))  # in the order of removal
    rows: list[Row] = []
    for step in NOTED[birth <= NOTED].tolist():
        age = step - birth
        if fate != "ray" and age >= AGES[-1]:
            if fate == "point":
                settled = min(1.0, (age - AGES[-1]) / 100)
                position = poses[birth, :2] + DISTANCES[best] * along[:, 0]
                position = position + settled * (LANDMARKS[landmark] + 0.2 - position)
                rows.append(Row(step, landmark, -1, 1.0, position, (0.6 - 0.4 * settled) ** 2 * np.eye(2)))
            continue
        left = sorted(order[sum(age >= each for each in AGES[:2]) :])
        favour = 1 + age / 10 * np.array([member == best for member in left])
        for member, weight in zip(left, favour / favour.sum(), strict=True):
            distance = DISTANCES[member]
            spread = np.diag([(0.3 * distance) ** 2, (BEARING_SIGMA * distance) ** 2]) / (1 + age / 20)
            position = poses[birth, :2] + distance * along[:, 0]
            rows.append(Row(step, landmark, member, float(weight), position, along @ spread @ along.T))
    return rows
