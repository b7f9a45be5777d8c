"""Check that a filtered estimate uses no later measurements: what it reports of a step must not depend on them."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.child import Host
from slamgauge.compare.estimators.user_errors import UserCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import wrap

PARTS = (0.25, 0.5, 0.75)  # fractions of the recording on which it runs again
JITTER = 0.1  # largest random change of a fraction, so that no code can know where its runs will end
SAME_POSE = 1e-5  # [m], [rad]: far above rounding, far below the effect of a measurement
SAME_COV = 1e-3  # relative to the product of both sigmas


def require_causal(host: Host, recording: Recording, estimate: Estimate) -> None:
    """Refuse a filtered estimate that differs from the estimates of the recordings up to some steps.

    The process `host` estimates these in the order of their lengths; it has never received later measurements.

    Raises:
        UserCodeError: it uses the future, or its estimates differ from run to run.
    """
    if estimate.kind != "filtered" or len(estimate.poses) != recording.steps + 1:  # `run_estimator` refuses the latter
        return
    parts = np.add(PARTS, np.random.default_rng().uniform(-JITTER, JITTER, len(PARTS)))
    steps = sorted({int(part * recording.steps) for part in parts} - {0})
    for step in steps:
        what = _difference(estimate, host.run(recording.first(step)).estimate, step)
        if what:
            _require_repeatable(host, recording.first(step))
            remedy = "store a pose before the next step begins, or say kind='smoothed'"
            raise UserCodeError(f"uses the future: from the recording up to step {step} alone, {what}; {remedy}")


def _require_repeatable(host: Host, recording: Recording) -> None:
    """Refuse an estimator whose estimates of one recording differ: the check cannot judge it."""
    answers = host.run(recording).estimate, host.run(recording).estimate
    if _difference(*answers, last=len(answers[0].poses) - 1):
        remedy = "seed its random numbers, and draw them step by step"
        raise UserCodeError(f"its answers to one recording differ from run to run; {remedy}")


def _difference(estimate: Estimate, part: Estimate, last: int) -> str:
    """Describe the first difference up to step `last` from an estimate that ends there; empty if they agree."""
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
    """Return the first step at which the values differ, or only one of them is NaN."""
    rows = (is_apart | (np.isnan(ours) != np.isnan(theirs))).reshape(len(ours), -1).any(axis=1)
    return int(rows.argmax()) if rows.any() else None
