"""A filtered estimate held to its word: what it says of a step may not depend on what comes after it."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.isolated_process import Isolated, Spent
from slamgauge.compare.estimators.user_code import OwnCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import wrap

PARTS = (0.25, 0.5, 0.75)  # of the recording, which it is run on again
SAME_POSE = 1e-5  # [m], [rad]: far above rounding, far below what a step tells
SAME_COV = 1e-3  # of the product of both sigmas


class Strict:
    """An estimator in a process of its own, looked at for the future at every run.

    Args:
        estimator: in its process.
    """

    def __init__(self, estimator: Isolated) -> None:
        self.estimator = estimator

    @property
    def spent(self) -> Spent:
        """What its last run has cost, the looking not counted."""
        return self.estimator.spent

    def __call__(self, recording: Recording) -> Estimate:
        """Run it, and look.

        Raises:
            OwnCodeError: it raised, or uses the future.
        """
        estimate = self.estimator(recording)
        require_causal(self.estimator, recording, estimate)
        return estimate


def require_causal(estimator: Isolated, recording: Recording, estimate: Estimate) -> None:
    """Refuse a filtered estimate that the recordings up to some steps do not lead to.

    They are given to another process, the shortest first, so that nobody remembers what came later.

    Raises:
        OwnCodeError: it uses the future, or its answers differ from run to run.
    """
    if estimate.kind != "filtered" or len(estimate.poses) != recording.steps + 1:  # the latter is refused by itself
        return
    steps = sorted({int(part * recording.steps) for part in PARTS} - {0})
    with estimator.fresh() as other:
        for step in steps:
            what = _difference(estimate, other(recording.first(step)), step)
            if what:
                _require_repeatable(estimator, recording.first(step))
                remedy = "store a pose before the next step begins, or say kind='smoothed'"
                raise OwnCodeError(f"uses the future: from the recording up to step {step} alone, {what}; {remedy}")


def _require_repeatable(estimator: Isolated, recording: Recording) -> None:
    """Refuse an estimator whose answers to one recording differ: it cannot be told whether it uses the future."""
    with estimator.fresh() as one, estimator.fresh() as another:
        answers = one(recording), another(recording)
        if _difference(*answers, last=len(answers[0].poses) - 1):
            remedy = "seed its random numbers, and draw them step by step"
            raise OwnCodeError(f"its answers to one recording differ from run to run; {remedy}")


def _difference(estimate: Estimate, part: Estimate, last: int) -> str:
    """What of the steps up to `last` is not as in an estimate that ends there; nothing if all is."""
    if len(part.poses) != last + 1:
        return f"it returns {len(part.poses)} poses, not {last + 1}"
    apart = np.abs(estimate.poses[: last + 1] - part.poses)
    apart[:, 2] = np.abs(wrap(apart[:, 2]))
    moved = _differing(apart > SAME_POSE, estimate.poses[: last + 1], part.poses)
    if moved is not None:
        return f"the pose of step {moved} is another, {np.nanmax(apart[moved], initial=0.0):.2g} m or rad away"
    if estimate.pose_covs is None or part.pose_covs is None:
        return ""
    covs = estimate.pose_covs[: last + 1]
    sigmas = np.sqrt(np.diagonal(covs, axis1=1, axis2=2).clip(min=0.0))
    bounds = SAME_COV * sigmas[:, :, None] * sigmas[:, None, :] + SAME_POSE**2
    changed = _differing(np.abs(covs - part.pose_covs) > bounds, covs, part.pose_covs)
    return "" if changed is None else f"the covariance of step {changed} is another"


def _differing(is_apart: np.ndarray, ours: Float, theirs: Float) -> int | None:
    """The first step at which they differ, or one of them is NaN alone."""
    rows = (is_apart | (np.isnan(ours) != np.isnan(theirs))).reshape(len(ours), -1).any(axis=1)
    return int(rows.argmax()) if rows.any() else None
