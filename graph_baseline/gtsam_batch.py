"""GTSAM's batch solution of a recording: factors, initial values, Levenberg-Marquardt, marginal covariances.

The graph has a pose X(k) for each step k = 0..N and a point L(id) for each landmark. `batch` solves the same problem
without the approximations listed in `gtsam_batch`. A test compares both on every shipped scenario.
"""

from __future__ import annotations

from itertools import compress

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from slamgauge.arrays import Int
from slamgauge.covariances import without_negative_eigenvalues
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import gtsam_conversions as convert
from slamgauge.graph_baseline.gtsam_incremental import Factors, isam2_path
from slamgauge.graph_baseline.problem import placement, preparation
from slamgauge.graph_baseline.problem.undetermined import explained
from slamgauge.recording import Recording

# Standard deviation in a direction of zero variance, relative to the largest standard deviation of the same step:
# 0.1 mm for the robot of the exercise, with 30 mm along the heading. GTSAM's damped and incremental solvers do not
# converge well with constraints. With 1/400 `Marginals` reports an undetermined landmark on q3-scale-0.1.
REGULARISING_NOISE = 1.0 / 300.0
START_NOISE = 0.1  # the same for the initial values; iSAM2's fast factorisation (Cholesky) needs more
SMALLEST_DECREASE = 1e-6  # relative, of the cost; a smaller decrease moves a pose by less than 0.0015 sigma


def gtsam_batch(recording: Recording, association: Int | None = None, initial: Estimate | None = None) -> Estimate:
    """Return GTSAM's maximum a posteriori path and map given all measurements, with their marginal covariances.

    Differences from the exact optimum, because of limits of GTSAM:

    - Levenberg-Marquardt stops early with constraints. Therefore a direction of zero variance gets regularising noise
      of 1/300 of the largest standard deviation of its step. On the shipped scenarios with ranges, seeds 0 to 9, this
      moves poses by less than 0.001 of their standard deviation, and changes standard deviations by less than 0.01 %
      (on bailey-2006, which starts at a known pose, by 0.04 mm at step 1 and less than 0.4 % from step 2 on).
    - An observation of the `position` sensor becomes a range and a bearing, with the covariance converted at the
      measured point. This moves poses by up to 0.07 standard deviations on ukfm-slam2d, and 0.24 on huang-2010.
    - A bearing-only landmark that its bearings do not place from the initial path, for example a single bearing, is not
      in the graph; its `association` is -1.
    - Levenberg-Marquardt converges to the minimum near the initial path. `batch` tries several starts.
    - `Marginals` is slow if each scan observes most of a large map: 45 s for 300 landmarks and 1257 poses. The rest
      takes 5 s for the same recording, and `batch` 6 s in total. It is fast if each scan observes few landmarks of a
      large map: 4 s for 10 000 landmarks, for which `batch` takes 33 s.

    Args:
        recording: measurements.
        association: (M,) ids that replace those of the recording; -1 excludes an observation.
        initial: estimate whose path is the initial value; the observations place landmarks from it. None: iSAM2's path.

    Raises:
        UserError: the association is unknown, or the measurements leave a variable undetermined.
    """
    # relative to the start pose, because coordinates far from the origin lose digits
    problem = preparation.prepare(preparation.in_frame_of_start(recording), association)
    observations = observation_factors(problem)
    with explained():  # an error of GTSAM becomes one line
        if initial is None:
            path = isam2_path(problem, motion_factors(problem, START_NOISE), observations)
        else:
            path = preparation.path_from_start(initial, recording)
        used = placement.are_placed(problem, path)
        placed = problem.only(used)
        landmark_ids = placed.landmark_ids
        initial_values = convert.make_values(path, landmark_ids, placement.landmarks_at_median(placed, path))

        graph = gtsam.NonlinearFactorGraph()
        for factor in [*motion_factors(problem), *compress(observations, used)]:
            graph.add(factor)

        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setRelativeErrorTol(0.0)
        parameters.setAbsoluteErrorTol(SMALLEST_DECREASE)
        result = gtsam.LevenbergMarquardtOptimizer(graph, initial_values, parameters).optimize()

        marginals = convert.marginals_of(graph, result)
        pose_covs = np.array([marginals.marginalCovariance(X(k)) for k in range(problem.steps + 1)])
        landmark_covs = np.array([marginals.marginalCovariance(L(name)) for name in landmark_ids.tolist()])
    poses, landmarks = convert.read_values(result)
    estimate = Estimate(
        kind="smoothed",
        poses=poses,
        pose_covs=without_negative_eigenvalues(convert.covariance_in_world(poses[:, 2], pose_covs)),
        landmark_ids=landmark_ids,
        landmarks=landmarks,
        landmark_covs=without_negative_eigenvalues(landmark_covs.reshape(-1, 2, 2)),
        association=np.where(used, problem.landmark, -1),
    )
    return preparation.with_association(preparation.in_world_frame(estimate, recording.prior_mean), association)


def motion_factors(problem: preparation.Problem, regularising: float = REGULARISING_NOISE) -> Factors:
    """Return N+1 factors: the prior of the start pose, and one per odometry increment."""
    noise = convert.motion_noise(problem, regularising)
    factors: Factors = [gtsam.PriorFactorPose2(X(0), gtsam.Pose2(*problem.prior_mean), noise[0])]
    for k, increment in enumerate(problem.odometry.tolist(), start=1):
        factors.append(gtsam.BetweenFactorPose2(X(k - 1), X(k), gtsam.Pose2(*increment), noise[k]))
    return factors


def observation_factors(problem: preparation.Problem) -> Factors:
    """Return M factors, one per observation.

    Raises:
        UserError: the observations do not determine a landmark.
    """
    placement.require_placeable(problem)
    measured, covs = preparation.as_range_bearing(problem)
    steps, names = problem.observation_step.tolist(), problem.landmark.tolist()
    factors: Factors = []
    for k, name, noise, *z in zip(steps, names, convert.observation_noise(covs), *measured.T.tolist(), strict=True):
        if problem.sensor == "bearing":
            factors.append(gtsam.BearingFactor2D(X(k), L(name), gtsam.Rot2(z[0]), noise))
        else:
            factors.append(gtsam.BearingRangeFactor2D(X(k), L(name), gtsam.Rot2(z[1]), z[0], noise))
    return factors
