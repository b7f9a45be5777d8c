"""The filters as estimators: a loop over the steps of the online filters."""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter

import numpy as np

from slamgauge.arrays import distinct, freeze
from slamgauge.blas_threads import one_blas_thread
from slamgauge.ekf.associating_filter import AssociatingFilter
from slamgauge.ekf.bearings.bearing_filter import BearingFilter
from slamgauge.ekf.maps.correction_table import CORRECTIONS, Correction
from slamgauge.ekf.maps.input_checks import without_rounding
from slamgauge.ekf.online_filter import Members, OnlineFilter, joined
from slamgauge.ekf.settings import DEFAULTS, FilterSettings
from slamgauge.ekf.slam_filter import SlamFilter
from slamgauge.estimate import Estimate, MapHistory
from slamgauge.memory import require_memory
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS
from slamgauge.validation import require_type

ROOM = 1.5  # memory of a filter divided by that of its covariance


def ekf_slam(recording: Recording, settings: FilterSettings = DEFAULTS) -> Estimate:
    """Textbook EKF-SLAM (the exercise, equation 1.1).

    Example:
        >>> truth, recording = slamgauge.simulate("q1-long-dense", seed=0)
        >>> estimate = slamgauge.ekf_slam(recording)
        >>> print(estimate.poses[-1], estimate.pose_covs[-1])

    Args:
        recording: prior, odometry and observations with their assumed covariances (`slamgauge.Recording`), with ids of
            landmarks or without.
        settings: `slamgauge.ekf.FilterSettings(association, initialisation, frames, robust)`. Without ids, the default
            is the exercise's nearest neighbour with gate 9; bearing-only landmarks start as rays (FIS).

    Returns:
        Filtered estimate: at each of the steps 0..N the pose x, y [m], heading [rad] in the world frame (N+1, 3) from
        the measurements up to this step, its covariance (N+1, 3, 3) and NIS; the last map, and the association (M,).

    Raises:
        UserError: a bearing-only recording without ids; a map larger than the free memory; or an update that does not
            exist in double precision, because standard deviations are too far apart or the filter has diverged.
    """
    return _run(recording, "ekf", settings)


def fej_ekf(recording: Recording, settings: FilterSettings = DEFAULTS) -> Estimate:
    """EKF-SLAM with first-estimates Jacobians (Huang, Mourikis and Roumeliotis, IJRR 2010); called as `ekf_slam`.

    It needs good first estimates: it can diverge if landmarks are close to the robot, or if the pose is uncertain at
    their first observation.
    """
    return _run(recording, "fej-ekf", settings)


def oc_ekf(recording: Recording, settings: FilterSettings = DEFAULTS) -> Estimate:
    """Observability-constrained EKF-SLAM (Huang, Mourikis and Roumeliotis, IJRR 2010); called as `ekf_slam`.

    Like `fej_ekf` it gains no information about translation and rotation of the whole map. Its Jacobians are taken at
    the newest estimates and changed as little as possible: it depends less on good first estimates.
    """
    return _run(recording, "oc-ekf", settings)


def iekf(recording: Recording, settings: FilterSettings = DEFAULTS) -> Estimate:
    """Iterated EKF-SLAM (Bell and Cathey 1993), known to be less consistent than the EKF; called as `ekf_slam`."""
    return _run(recording, "iekf", settings)


def riekf(recording: Recording, settings: FilterSettings = DEFAULTS) -> Estimate:
    """Right-invariant EKF-SLAM (Barrau and Bonnabel, arXiv 1510.06263); called as `ekf_slam`."""
    return _run(recording, "riekf", settings)


def dead_reckoning(recording: Recording) -> Estimate:
    """Dead reckoning: prior and odometry, without observations."""
    require_type("recording", recording, Recording)
    found = ekf_slam(recording.only(np.zeros(len(recording.observation), dtype=bool)))
    return Estimate(kind="filtered", poses=found.poses, pose_covs=found.pose_covs, seconds=found.seconds)


def drive(slam: OnlineFilter, recording: Recording) -> Iterator[tuple[float, int, float]]:
    """Run a filter on a recording; yield NIS, its degrees of freedom and computing time [s] of step 0, 1, ..., N."""
    for step, scan in enumerate(recording.scans()):
        start = perf_counter()
        if step > 0:
            slam.predict(recording.odometry[step - 1], recording.odometry_cov[step - 1])
        nis, dof = slam.update(scan) if len(scan.value) else (0.0, 0)
        yield nis, dof, perf_counter() - start


def _run(recording: Recording, estimator: str, settings: FilterSettings) -> Estimate:
    require_type("recording", recording, Recording)
    require_type("settings", settings, FilterSettings)
    with one_blas_thread():
        return _driven(online_filter(recording, CORRECTIONS[estimator], settings), recording, settings.frames)


def _driven(slam: OnlineFilter, recording: Recording, frames: int) -> Estimate:
    steps = recording.steps
    poses, pose_covs = np.empty((steps + 1, 3)), np.empty((steps + 1, 3, 3))
    nis, nis_dof, seconds = np.zeros(steps + 1), np.zeros(steps + 1, dtype=np.int64), np.zeros(steps + 1)
    own, members = recording.landmark, np.zeros(steps + 1, np.int64)
    association = np.empty(len(recording.observation), np.int64) if own is None else own  # shared while both are equal
    wanted, maps = steps_of_frames(steps, frames), dict[int, Members]()
    first = 0
    for step, result in enumerate(drive(slam, recording)):
        nis[step], nis_dof[step], seconds[step] = result
        poses[step], pose_covs[step] = slam.pose, slam.pose_cov
        members[step] = slam.member_count
        rows = slice(first, first + len(slam.associated))
        if (association[rows] != slam.associated).any():
            association = association if association.flags.writeable else association.copy()
            association[rows] = slam.associated
        first = rows.stop
        if step in wanted:
            maps[step] = slam.whole_map()
    association = slam.standing(association)
    pose_covs = without_rounding("pose_covs", pose_covs)
    freeze(poses, pose_covs, nis, nis_dof, seconds)
    return Estimate(
        kind="filtered",
        poses=poses,
        pose_covs=pose_covs,
        landmark_ids=slam.landmark_ids,
        landmarks=slam.landmarks,
        landmark_covs=without_rounding("landmark_covs", slam.landmark_covs),
        association=association,
        nis=nis,
        nis_dof=nis_dof,
        seconds=seconds,
        rays=slam.ray_log(members),
        history=_history(maps) if maps else None,
    )


def steps_of_frames(steps: int, frames: int) -> set[int]:
    """Return `frames` of the steps 0..`steps`, evenly spread, with the first and the last."""
    return {*np.linspace(0, steps, min(frames, steps + 1)).round().astype(int).tolist()}


def _history(maps: dict[int, Members]) -> MapHistory:
    """Return the maps by step as one table."""
    rows = joined([*maps.values()])
    step = np.repeat([*maps], [len(each.landmark) for each in maps.values()])
    cov = without_rounding("history.cov", rows.cov)
    return MapHistory(step, rows.landmark, rows.number, np.minimum(rows.weight, 1.0), rows.position, cov)


def online_filter(recording: Recording, correction: Correction, settings: FilterSettings) -> OnlineFilter:
    """Return the online filter that fits the recording."""
    start = (recording.prior_mean, recording.prior_cov, correction)
    robust = settings.robust
    if not SENSORS[recording.sensor].places_landmarks:
        return BearingFilter(*start, settings.initialisation, robust)
    if recording.landmark is None:
        return AssociatingFilter(recording.sensor, *start, settings.association, robust)
    landmarks = len(distinct(recording.landmark))
    size = 3 + 2 * landmarks
    require_memory(8.0 * ROOM * size * size, f"the covariance of {landmarks} landmarks", "give fewer landmarks")
    return SlamFilter(recording.sensor, *start, landmarks=landmarks, robust=robust)
