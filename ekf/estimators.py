"""The filters as estimators: a loop over the online form."""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter
from typing import NamedTuple

import numpy as np

from ekf.association import AssociatingFilter, Association
from ekf.compressed import CompressedFilter
from ekf.filter import Correction, SlamFilter
from ekf.rays import RayFilter, Rays
from slam2d import Estimate, Int, Recording

CORRECTIONS: dict[str, Correction] = {
    "ekf": "standard",
    "fej-ekf": "first-estimates",
    "iekf": "iterated",
    "riekf": "right-invariant",
}
NEAREST_NEIGHBOUR = Association()  # the practical's rule and gate
RAYS = Rays()


def ekf(recording: Recording, association: Association = NEAREST_NEIGHBOUR, rays: Rays = RAYS) -> Estimate:
    """Textbook EKF-SLAM (the practical, equations 1.1).

    Args:
        recording: known or unknown association.
        association: how observations find their landmarks where the recording has no ids.
        rays: how landmarks begin where the recording has bearings alone.

    Raises:
        ValueError: bearings alone and unknown association at once.
    """
    return _run(recording, CORRECTIONS["ekf"], association, rays)


def fej_ekf(recording: Recording, association: Association = NEAREST_NEIGHBOUR, rays: Rays = RAYS) -> Estimate:
    """EKF-SLAM with first-estimates Jacobians (Huang, Mourikis and Roumeliotis, IJRR 2010); called as `ekf`.

    It leans on good first estimates: where landmarks are close to the robot, or first seen from a poorly known
    pose, it can diverge.
    """
    return _run(recording, CORRECTIONS["fej-ekf"], association, rays)


def iekf(recording: Recording, association: Association = NEAREST_NEIGHBOUR, rays: Rays = RAYS) -> Estimate:
    """Iterated EKF-SLAM (Bell and Cathey 1993), known to be less consistent than the plain EKF; called as `ekf`."""
    return _run(recording, CORRECTIONS["iekf"], association, rays)


def riekf(recording: Recording, association: Association = NEAREST_NEIGHBOUR, rays: Rays = RAYS) -> Estimate:
    """Right-invariant EKF-SLAM (Barrau and Bonnabel, arXiv 1510.06263); called as `ekf`."""
    return _run(recording, CORRECTIONS["riekf"], association, rays)


def dead_reckoning(recording: Recording) -> Estimate:
    """Odometry alone: the prior carried along the increments."""
    blind = SlamFilter("position", recording.prior_mean, recording.prior_cov, landmarks=0)
    poses, pose_covs = np.empty((recording.steps + 1, 3)), np.empty((recording.steps + 1, 3, 3))
    poses[0], pose_covs[0] = blind.pose, blind.pose_cov
    seconds = np.zeros(recording.steps + 1)
    for k in range(recording.steps):
        start = perf_counter()
        blind.predict(recording.odometry[k], recording.odometry_cov[k])
        seconds[k + 1] = perf_counter() - start
        poses[k + 1], pose_covs[k + 1] = blind.pose, blind.pose_cov
    return Estimate(kind="filtered", poses=poses, pose_covs=pose_covs, seconds=seconds)


class Step(NamedTuple):
    """What a step of a filter gave: NIS, its degrees of freedom, computing time."""

    nis: float
    nis_dof: int
    seconds: float


def drive(slam: SlamFilter | CompressedFilter | AssociatingFilter | RayFilter, recording: Recording) -> Iterator[Step]:
    """Feed a recording to a filter, step 0, 1, ..., N."""
    for k, scan in enumerate(recording.scans()):
        start = perf_counter()
        if k > 0:
            slam.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
        nis, dof = slam.update(scan) if len(scan.value) else (0.0, 0)
        yield Step(nis, dof, perf_counter() - start)


def _run(recording: Recording, correction: Correction, association: Association, rays: Rays) -> Estimate:
    start = (recording.prior_mean, recording.prior_cov, correction)
    if recording.sensor == "bearing":
        slam = RayFilter(*start, rays)
    elif recording.landmark is None:
        slam = AssociatingFilter(recording.sensor, *start, association)
    else:
        slam = SlamFilter(recording.sensor, *start, landmarks=len(np.unique(recording.landmark)))
    steps = recording.steps
    poses, pose_covs = np.empty((steps + 1, 3)), np.empty((steps + 1, 3, 3))
    nis, nis_dof, seconds = np.zeros(steps + 1), np.zeros(steps + 1, dtype=np.int64), np.zeros(steps + 1)
    given = [np.zeros(0, dtype=np.int64)]
    for k, step in enumerate(drive(slam, recording)):
        nis[k], nis_dof[k], seconds[k] = step
        poses[k], pose_covs[k] = slam.pose, slam.pose_cov
        if isinstance(slam, AssociatingFilter):
            given.append(slam.associated)
    return Estimate(
        kind="filtered",
        poses=poses,
        pose_covs=pose_covs,
        landmark_ids=slam.landmark_ids,
        landmarks=slam.landmarks,
        landmark_covs=slam.landmark_covs,
        association=_associations(slam, recording, given),
        nis=nis,
        nis_dof=nis_dof,
        seconds=seconds,
    )


def _associations(
    slam: SlamFilter | AssociatingFilter | RayFilter, recording: Recording, given: list[Int]
) -> Int | None:
    """What became of the associations (M,) that a filter has made; lost landmarks have none."""
    if isinstance(slam, AssociatingFilter):
        return slam.standing(np.concatenate(given))
    if isinstance(slam, RayFilter) and recording.landmark is not None:
        return np.where(np.isin(recording.landmark, slam.landmark_ids), recording.landmark, -1)
    return recording.landmark
