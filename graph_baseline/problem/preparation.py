"""Preparation of a recording for factor graphs: known ids, landmarks that can be placed, frame of the start pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property, wraps
from typing import Concatenate, ParamSpec

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.problem.placement import do_not_meet, triangulate_all
from slamgauge.graph_baseline.problem.undetermined import undetermined_variable
from slamgauge.recording import Recording
from slamgauge.se2 import between, chain, compose, pose_rotation, rotation
from slamgauge.sensors import SENSORS, inverse, jacobian, predict
from slamgauge.validation import require_type

Rest = ParamSpec("Rest")

POLAR = "range-bearing"
NEAREST = 1e-6  # smallest distance of an observed position [m]; a landmark at the sensor has no bearing
MAX_LANDMARK_SIGMA = 3e5  # m; the information of a larger value is rounding, relative to that of a millimetre


@dataclass(frozen=True, eq=False)
class Problem(Recording):
    """A recording with known association, and its landmarks, as `prepare` returns it."""

    landmark: Int

    @cached_property
    def landmark_ids(self) -> Int:
        """(L,) ids in increasing order."""
        return np.unique(self.landmark)

    @cached_property
    def slot(self) -> Int:
        """(M,) index in `landmark_ids` of the landmark of each observation."""
        return np.searchsorted(self.landmark_ids, self.landmark)

    @cached_property
    def dead_reckoning(self) -> Float:
        """(N+1, 3) path of dead reckoning: x, y [m], heading [rad]."""
        return chain(self.prior_mean, self.odometry)


def prepare(recording: Recording, association: Int | None = None) -> Problem:
    """Return the problem of a recording. `association` (M,) replaces its ids; None keeps them.

    Raises:
        UserError: unknown association.
    """
    if association is not None:
        recording = recording.associated(association)
    if isinstance(recording, Problem):
        return recording
    require_known_landmarks(recording)
    return Problem(**{field.name: getattr(recording, field.name) for field in fields(recording)})


def require_known_landmarks(recording: Recording) -> Int:
    """Return the ids (M,) of the observed landmarks of a recording.

    Raises:
        UserError: unknown association.
    """
    if recording.landmark is None:
        raise UserError("landmark: the graph needs known association; give ids, or use those of a filter, as batch@ekf")
    return recording.landmark


def as_range_bearing(recording: Recording) -> tuple[Float, Float]:
    """Return observations (M, d) as range [m] and bearing [rad], and their covariances (M, d, d).

    Only observations of the `position` sensor change; bearings remain alone, with d = 1.
    """
    if SENSORS[recording.sensor].has_bearing:
        return recording.observation, recording.observation_cov
    delta = inverse(recording.sensor, recording.observation)
    delta[np.hypot(*delta.T) < NEAREST, 0] = NEAREST
    A = jacobian(POLAR, delta, nearest=0.0)
    return predict(POLAR, delta), A @ recording.observation_cov @ A.swapaxes(1, 2)


def prior_cov_in_body(recording: Recording) -> Float:
    """Return the prior covariance (3, 3) in the frame of the prior mean, which is GTSAM's convention."""
    turn = pose_rotation(recording.prior_mean[2])
    return turn.T @ recording.prior_cov @ turn


def least_known_landmark(recording: Problem) -> tuple[int, float]:
    """Return the id of the landmark with the largest sigma, and this sigma [m] along its most uncertain direction.

    The path of dead reckoning is assumed to be exact. The result is (-1, 0.0) without observations.
    """
    if not SENSORS[recording.sensor].places_landmarks:
        ids, _, sigmas = triangulate_all(recording, recording.dead_reckoning)
        worst = int(np.argmax(sigmas)) if len(ids) else -1
        return (int(ids[worst]), float(sigmas[worst])) if len(ids) else (-1, 0.0)
    polar, polar_cov = as_range_bearing(recording)
    if len(polar) == 0:
        return -1, 0.0
    path = recording.dead_reckoning
    H = rotation(path[recording.observation_step, 2] + polar[:, 1]).swapaxes(1, 2)  # rows: along and across the ray
    H[:, 1] /= np.maximum(polar[:, :1], 1e-6)
    information = np.zeros((len(recording.landmark_ids), 2, 2))
    np.add.at(information, recording.slot, H.swapaxes(1, 2) @ np.linalg.inv(polar_cov) @ H)
    weakest = np.linalg.eigvalsh(information)[:, 0]
    worst = int(np.argmin(weakest))
    return int(recording.landmark_ids[worst]), float(1.0 / np.sqrt(max(weakest[worst], 1e-300)))


def require_placeable(recording: Problem) -> None:
    """Check that observations determine each landmark well enough for double precision; bearing-only passes.

    Raises:
        UserError: the sigma of a landmark exceeds MAX_LANDMARK_SIGMA.
    """
    if SENSORS[recording.sensor].places_landmarks:
        landmark, sigma = least_known_landmark(recording)
        if sigma > MAX_LANDMARK_SIGMA:
            raise undetermined_variable("l", landmark)


def are_placed(recording: Problem, path: Float) -> Marks:
    """Return a mask (M,) of the observations whose landmark has a position, given a path (N+1, 3).

    A sensor that measures ranges or positions places all landmarks. A bearing-only landmark cannot be placed from one
    observation or without parallax; its bearings contain almost no information about the path.
    """
    if SENSORS[recording.sensor].places_landmarks:
        return np.ones(len(recording.observation), dtype=bool)
    ids, _, sigmas = triangulate_all(recording, path)
    return np.isin(recording.landmark, ids[np.isfinite(sigmas)])


def are_placed_best(recording: Problem, path: Float, among: Marks) -> Marks:
    """Return a mask (M,) of the observations of the bearing-only landmarks with the smallest sigmas.

    These are half of the landmarks (rounded down) that have observations in the mask `among` (M,). They are
    triangulated from these observations and the path (N+1, 3).
    """
    ids, _, sigmas = triangulate_all(recording.only(among), path)
    return np.isin(recording.landmark, ids[np.argsort(sigmas, kind="stable")[: len(ids) // 2]])


def are_inconsistent(recording: Problem, path: Float, among: Marks) -> Marks:
    """Return a mask (M,) of the observations of landmarks whose precise bearings do not meet, given a path (N+1, 3).

    Only landmarks with observations in the mask `among` (M,) are checked.
    """
    ids = recording.landmark
    found = [name for name in np.unique(ids[among]) if do_not_meet(recording, np.flatnonzero(ids == name), path)]
    return np.isin(ids, found)


def are_reobserved(recording: Problem) -> Marks:
    """Return a mask (M,) of the observations of landmarks that are observed at two or more steps."""
    slot = recording.slot
    pairs = np.unique(np.column_stack([slot, recording.observation_step]), axis=0)
    return np.bincount(pairs[:, 0])[slot] > 1


def with_association(estimate: Estimate, association: Int | None) -> Estimate:
    """Return the estimate with an association for all M observations of the recording.

    Args:
        estimate: its association contains only the observations with an id >= 0 in `association`.
        association: (M,) ids that were used, -1 for unused observations; None returns the estimate unchanged.
    """
    if association is None:
        return estimate
    full = np.full(len(association), -1)
    full[np.asarray(association) >= 0] = estimate.association
    return replace(estimate, association=full)


def in_frame_of_start(recording: Recording) -> Recording:
    """Return the recording in the frame of its prior mean, so that the start pose is 0."""
    require_type("recording", recording, Recording)
    if not recording.prior_mean.any():
        return recording
    return replace(recording, prior_mean=np.zeros(3), prior_cov=prior_cov_in_body(recording))


def path_from_start(estimate: Estimate, recording: Recording) -> Float:
    """Return the path (N+1, 3) of an estimate of the recording, in the frame of the recording's prior mean.

    Raises:
        UserError: it is not an estimate of this recording.
    """
    require_type("initial", estimate, Estimate)
    if len(estimate.poses) != recording.steps + 1:
        raise UserError(
            f"initial: has {len(estimate.poses)} poses, and the recording {recording.steps + 1}; "
            "give an estimate of this recording"
        )
    return between(recording.prior_mean, estimate.poses)


def in_world_frame(estimate: Estimate, start: Float) -> Estimate:
    """Return an estimate of the recording `in_frame_of_start` in the world frame, in which the start pose is (3,)."""
    if not start.any():
        return estimate
    turn = pose_rotation(start[2])
    assert estimate.pose_covs is not None and estimate.landmark_covs is not None
    return replace(
        estimate,
        poses=compose(start, estimate.poses),
        pose_covs=turn @ estimate.pose_covs @ turn.T,
        landmarks=start[:2] + estimate.landmarks @ turn[:2, :2].T,
        landmark_covs=turn[:2, :2] @ estimate.landmark_covs @ turn[:2, :2].T,
    )


def relative_to_start(
    estimator: Callable[Concatenate[Recording, Rest], Estimate],
) -> Callable[Concatenate[Recording, Rest], Estimate]:
    """Wrap an estimator so that it computes in the frame of the start pose, and returns its result in the world frame.

    The wrapped estimator loses no digits far from the origin, and its accuracy does not depend on the initial heading.
    """

    @wraps(estimator)
    def relative(recording: Recording, /, *rest: Rest.args, **named: Rest.kwargs) -> Estimate:
        return in_world_frame(estimator(in_frame_of_start(recording), *rest, **named), recording.prior_mean)

    return relative


def landmarks_at_median(recording: Problem, poses: Float) -> Float:
    """Return landmark positions (L, 2) [m] in increasing id order, given `poses` (N+1, 3).

    Each coordinate is the median over the positions that the observations of the landmark give, so that misread ids do
    not move landmarks; bearing-only landmarks are triangulated.
    """
    if not SENSORS[recording.sensor].places_landmarks:
        return triangulate_all(recording, poses)[1]
    slot, seen_from = recording.slot, poses[recording.observation_step]
    offset = inverse(recording.sensor, recording.observation)
    points = seen_from[:, :2] + np.einsum("mij,mj->mi", rotation(seen_from[:, 2]), offset)
    count = np.bincount(slot)
    middle = np.cumsum(count) - count + count // 2
    return np.column_stack([each[np.lexsort((each, slot))][middle] for each in points.T])
