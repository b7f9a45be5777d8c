"""Cramer-Rao bound: the smallest error covariance of an unbiased estimator, from the truth and the noise.

The information of a run is the sum of J' R^-1 J over its prior, its motions and its observations, with J at the
true path and map. Blocks of its inverse bound the error covariance of every estimator: for each pose given the
measurements up to it (causal), and given all measurements (hindsight). Landmarks have no prior. The motion model is
that of the simulation, which adds noise to the increment in the frame of the step's start. A motion without lateral
noise has infinite information; the covariance form of the same inverse is then exact (`elimination`).

The bound of a run is conditional on its path and its set of observations, and assumes Gaussian noise with the stated
covariances. Its mean over the paths is at least the inverse of the mean information, the posterior bound of
Tichavsky, Muravchik & Nehorai (IEEE TSP 46(5), 1998), because the inverse is convex; both are equal if all runs
take the same path.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import get_lapack_funcs

from slamgauge.arrays import Float
from slamgauge.errors import UserError
from slamgauge.graph_baseline.problem.linearisation import LinearModel, Scans, empty_model, graph_arrays, linearise
from slamgauge.graph_baseline.problem.placement import MAX_LANDMARK_SIGMA, are_reobserved
from slamgauge.graph_baseline.problem.preparation import prepare
from slamgauge.graph_baseline.solver.elimination import eliminate_poses, empty_chain, empty_frontier
from slamgauge.graph_baseline.solver.smoother import NOT_DAMPED, require_memory_for, solve
from slamgauge.recording import Recording
from slamgauge.se2 import pose_rotation
from slamgauge.sensors import SENSORS
from slamgauge.truth import Truth

# These are three times faster than the wrappers of scipy.
factorise, solve_triangular = get_lapack_funcs(("potrf", "trtrs"), dtype=np.float64)


def causal_bound(truth: Truth, recording: Recording) -> Float:
    """Return Cramer-Rao bounds (N+1, 3, 3) of each pose's error covariance given the measurements up to the pose.

    The errors are additive, in the world frame.

    Args:
        truth: all poses, landmarks and associations; clutter and outliers are ignored.
        recording: measurements with their true covariances.

    Raises:
        UserError: the truth is incomplete.
    """
    scans, model, landmarks = model_at_truth(truth, recording)
    chain, front = empty_chain(len(model.c)), empty_frontier(2 * landmarks)
    vague = 1.0 / MAX_LANDMARK_SIGMA**2  # a single bearing does not determine a landmark
    front.information[np.arange(1, len(front.information)), np.arange(1, len(front.information))] = vague
    covs, width = np.empty((len(model.c), 3, 3)), 1
    factor = front.information[:0, :0]
    for k in range(len(covs)):
        slots = scans.slot[scans.first[k] : scans.first[k + 1]]
        width = max(width, 3 + 2 * int(slots.max(initial=-1)))
        maps, rows = np.empty((2, 1, 3, width))
        eliminate_poses(scans, model, NOT_DAMPED.pose, chain, front, (k, k + 1), maps, rows)
        if len(slots):
            information = front.information[:width, :width]
            information += rows[0].T @ rows[0]
            factor, failed = factorise(information[1:, 1:], lower=1, clean=0)
            if failed:
                raise np.linalg.LinAlgError("the information of the landmarks is not positive definite")
        covs[k] = front.P
        if width > 1:
            spread = solve_triangular(factor, front.M[:, 1:width].T, lower=1)[0]
            covs[k] += spread.T @ spread
    return covs


def hindsight_bound(truth: Truth, recording: Recording) -> Float:
    """Return bounds (N+1, 3, 3) given all measurements; arguments and errors as in `causal_bound`."""
    scans, model, landmarks = model_at_truth(truth, recording)
    return solve(model, scans, landmarks).pose_covs


def model_at_truth(truth: Truth, recording: Recording) -> tuple[Scans, LinearModel, int]:
    """Return the linear model at the truth and its number of landmarks, whose slots are in order of observation."""
    if truth.poses is None or truth.landmarks is None or truth.association is None or np.isnan(truth.poses).any():
        raise UserError("truth: the bound needs all true poses, landmarks and associations; simulate a scenario")
    assert truth.landmark_ids is not None
    assert truth.misleading is not None
    association = np.where(truth.misleading, -1, truth.association)
    is_associated = recording.landmark is not None and np.array_equal(association, recording.landmark)
    seen = prepare(recording if is_associated else recording.associated(association))
    require_memory_for(seen, "bound")
    if not SENSORS[seen.sensor].places_landmarks:
        seen = seen.only(are_reobserved(seen))  # a single bearing has no information about the path
    by_first_observation = np.argsort(seen.first_row)
    order = np.argsort(truth.landmark_ids)
    ids = seen.landmark_ids[by_first_observation]
    landmarks = truth.landmarks[order[np.searchsorted(truth.landmark_ids, ids, sorter=order)]]
    arrays = graph_arrays(seen)._replace(slot=np.argsort(by_first_observation)[seen.slot])
    model = empty_model(seen.steps + 1, *arrays.value.shape)
    linearise(arrays, truth.poses, landmarks, (0, seen.steps + 1), model)
    turn = pose_rotation(truth.poses[:-1, 2])
    model.W[0], model.W[1:] = recording.prior_cov, turn @ recording.odometry_cov @ turn.swapaxes(1, 2)
    return Scans(arrays.first, arrays.slot), model, len(ids)
