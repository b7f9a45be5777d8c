"""The estimator between filter and optimum: smooth the last steps anew at every step, marginalise what is older."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from slamgauge.arrays import Int
from slamgauge.covariances import without_negative_eigenvalues
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline.problem.gtsam_missing import gtsam_needed
from slamgauge.graph_baseline.problem.preparation import among_mapped, relative_to_start, require_known_landmarks
from slamgauge.graph_baseline.problem.undetermined import explained
from slamgauge.recording import Recording
from slamgauge.validation import require_lag

LAG = 20  # steps


@relative_to_start
def fixed_lag(recording: Recording, association: Int | None = None, lag: int = LAG) -> Estimate:
    """The newest pose of GTSAM's fixed-lag smoother at every step; landmarks are kept.

    A pose is linearised anew as long as it is in the window; what is marginalised stays linearised where it was. With
    bearings alone a landmark waits for bearings of the window to place it; what the window leaves behind is lost.

    Args:
        recording: what was measured.
        association: (M,) ids in place of the recording's own; -1 leaves an observation out.
        lag: steps that stay in the window, at least 1.

    Raises:
        UserError: the recording cannot be turned into a graph or leaves a variable undetermined, the lag is none, or
            there is no GTSAM on this system.
    """
    lag = min(require_lag(lag), max(recording.steps, 1))
    if association is not None:
        return among_mapped(fixed_lag(recording.associated(association), lag=lag), association)
    with gtsam_needed("causal"):
        from slamgauge.graph_baseline.gtsam_fixed_lag import LaggingOptimum
    optimum, steps = LaggingOptimum(recording, lag), recording.steps
    poses, pose_covs, seconds = np.empty((steps + 1, 3)), np.empty((steps + 1, 3, 3)), np.zeros(steps + 1)
    with explained():
        for k in range(steps + 1):
            start = perf_counter()
            poses[k], pose_covs[k] = optimum.add_step(k)
            seconds[k] = perf_counter() - start
        ids, landmarks, landmark_covs = optimum.landmarks()
    return Estimate(
        kind="filtered",
        poses=poses,
        pose_covs=without_negative_eigenvalues(pose_covs),
        landmark_ids=ids,
        landmarks=landmarks,
        landmark_covs=without_negative_eigenvalues(landmark_covs),
        association=np.where(optimum.taken, require_known_landmarks(recording), -1),
        seconds=seconds,
    )
