"""Preparation of a recording for factor graphs: known ids, range and bearing, frame of the start pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property, wraps
from typing import Concatenate, ParamSpec

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.blas_threads import one_blas_thread
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import between, chain, compose, pose_rotation
from slamgauge.sensors import SENSORS, inverse, jacobian, predict
from slamgauge.validation import require_type

Rest = ParamSpec("Rest")

POLAR = "range-bearing"
NEAREST = 1e-6  # smallest distance of an observed position [m]; a landmark at the sensor has no bearing


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
    def first_row(self) -> Int:
        """(L,) row of the first observation of each landmark."""
        return np.unique(self.landmark, return_index=True)[1]

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
    if recording.landmark is None:
        raise UserError("landmark: the graph needs known association; give ids, or use those of a filter, as batch@ekf")
    return Problem(**{field.name: getattr(recording, field.name) for field in fields(recording)})


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
    It runs with one BLAS thread.
    """

    @wraps(estimator)
    def relative(recording: Recording, /, *rest: Rest.args, **named: Rest.kwargs) -> Estimate:
        with one_blas_thread():
            estimate = estimator(in_frame_of_start(recording), *rest, **named)
        return in_world_frame(estimate, recording.prior_mean)

    return relative
