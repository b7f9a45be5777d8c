"""Cramer-Rao bound: the smallest error covariance of an unbiased estimator, from the truth and the noise.

The information of a run is the sum of J' R^-1 J over its prior, its motions and its observations, with J at the
true path and map. Blocks of its inverse bound the error covariance of every estimator: for each pose given the
measurements up to it (causal), and given all measurements (hindsight). Landmarks have no prior. The motion model is
that of the simulation, which adds noise to the increment in the frame of the step's start. A motion without lateral
noise has infinite information; the covariance form of the same inverse is then exact (`smoother`).

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
from slamgauge.graph_baseline.problem.linearisation import LinearModel, linearise
from slamgauge.graph_baseline.problem.preparation import MAX_LANDMARK_SIGMA, are_reobserved, prepare
from slamgauge.graph_baseline.solver.cost_estimate import require_memory_for
from slamgauge.graph_baseline.solver.reduced_scans import NOT_DAMPED, compressed_scans, filter_covariances, filter_maps
from slamgauge.graph_baseline.solver.smoother import solve
from slamgauge.graph_baseline.solver.warm_up import compile_graphs_once
from slamgauge.recording import Recording
from slamgauge.se2 import pose_rotation
from slamgauge.sensors import SENSORS
from slamgauge.truth import Truth

# These are three times faster than the wrappers of scipy.
factorise, solve_triangular = get_lapack_funcs(("potrf", "trtrs"), dtype=np.float64)


def causal_bound(truth: Truth, recording: Recording) -> Float:
    """Return bounds (N+1, 3, 3) of each pose's error covariance given the measurements up to the pose.

    The errors are additive, in the world frame.

    Args:
        truth: all poses, landmarks and associations; clutter and outliers are ignored.
        recording: measurements with their true covariances.

    Raises:
        UserError: the truth is incomplete.
    """
    model, landmarks = model_at_truth(truth, recording)
    return causal_covariances(model, landmarks)


def hindsight_bound(truth: Truth, recording: Recording) -> Float:
    """Return bounds (N+1, 3, 3) given all measurements; arguments and errors as in `causal_bound`."""
    model, landmarks = model_at_truth(truth, recording)
    return solve(model, landmarks).pose_covs


def model_at_truth(truth: Truth, recording: Recording) -> tuple[LinearModel, int]:
    """Return the linear model at the truth and its number of landmarks, numbered by first observation."""
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
    ids, first, slot = np.unique(seen.landmark, return_index=True, return_inverse=True)
    by_first_observation = np.argsort(first)
    order = np.argsort(truth.landmark_ids)
    landmarks = truth.landmarks[order[np.searchsorted(truth.landmark_ids, ids[by_first_observation], sorter=order)]]
    turn = pose_rotation(truth.poses[:-1, 2])
    model = linearise(seen, np.argsort(by_first_observation)[slot], truth.poses, landmarks)
    at_truth = model._replace(start_cov=recording.prior_cov, W=turn @ recording.odometry_cov @ turn.swapaxes(1, 2))
    return at_truth, len(ids)


def causal_covariances(model: LinearModel, landmarks: int) -> Float:
    """Return covariances (N+1, 3, 3) of each pose given the scans up to it; slots are in order of observation."""
    compile_graphs_once()
    G, X = compressed_scans(model, landmarks, NOT_DAMPED, 2 * landmarks)
    P, updated, carry, gain, whitener = filter_covariances(model, G)
    start = np.zeros((3, 2 * landmarks + 1))
    start[:, -1] = model.start
    A = filter_maps(start, model.c, X, carry, gain)
    innovation = whitener @ (G @ A + X)
    A -= P @ (whitener @ G).swapaxes(1, 2) @ innovation  # update with the scan of each pose
    pairs, of_row = np.unique(model.step * landmarks + model.slot, return_inverse=True)
    pair_information = np.zeros((len(pairs), 2, 2))  # information of each scan about each landmark that it observes
    np.add.at(pair_information, of_row, model.Hm.swapaxes(1, 2) @ model.Hm)
    step, slot = np.divmod(pairs, max(landmarks, 1))
    first = np.searchsorted(step, np.arange(len(G) + 1)).tolist()
    # Eliminating the poses adds the products of `innovation` to the landmarks' information and subtracts those of X.
    rows = np.concatenate([innovation, X], axis=1)
    signed = rows * np.repeat([1.0, -1.0], 3)[:, None]
    information = np.eye(2 * landmarks) / MAX_LANDMARK_SIGMA**2  # a single bearing does not determine a landmark
    blocks = information.reshape(landmarks, 2, landmarks, 2)
    covs, width, factor = updated.copy(), 0, information[:0, :0]
    for k in range(len(G)):
        slots = slot[first[k] : first[k + 1]]
        if len(slots):
            width = max(width, 2 * (int(slots[-1]) + 1))
            known = information[:width, :width]
            blocks[slots, :, slots] += pair_information[first[k] : first[k + 1]]
            known += rows[k, :, :width].T @ signed[k, :, :width]
            factor, failed = factorise(known, lower=1, clean=0)
            if failed:
                raise np.linalg.LinAlgError("the information of the landmarks is not positive definite")
        if width:
            spread = solve_triangular(factor, A[k, :, :width].T, lower=1)[0]
            covs[k] += spread.T @ spread
    return covs
