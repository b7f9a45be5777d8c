"""Inputs that a filter ignores: noise of the recording, its prior, and ids.

A right filter may have its own noise in its file, and may associate observations on its own. A check that varies an
ignored input does not judge such a filter. The test is a run with the input changed: the estimate must be the same.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamgauge.compare.checks.check import Need, Subject
from slamgauge.compare.checks.small_recordings import KNOWN_START, SIGMA, ahead, walk
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

SEED, LOUDER = 0, 4.0  # seed of the recording, and factor of changed covariances
IMPRECISE = 0.05  # assumed sigma of observations [m], [rad]
UNCERTAIN = 1e-11  # variance [m^2, rad^2]; those of a known start, and of a landmark due to it, are below a tenth


def ignored_inputs(subject: Subject) -> frozenset[Need]:
    """Return the inputs without effect on the estimates.

    The recording is a walk with turns towards three landmarks, from a known start and with a little noise. Estimators
    assume much noise, so that a wrong correction of a covariance does not make it negative at once.

    A filter without any noise or without an uncertain start is wrong: these inputs do not count as ignored. For filters
    with random estimates or without corrections by observations, no input does.

    Raises:
        UserError: the filter fails on the plain recording.
    """
    rng = np.random.default_rng(SEED)
    world = replace(walk(rng, ahead(rng), turn=0.2), prior_cov=KNOWN_START)
    plain = world.noisy(rng, sigma=IMPRECISE)
    estimate, count = subject(plain), len(plain.observation)
    changes: dict[Need, Recording] = {
        "odometry noise": replace(plain, odometry_cov=LOUDER * plain.odometry_cov),
        "observation noise": replace(plain, observation_cov=LOUDER * plain.observation_cov),
        "prior": replace(plain, prior_cov=0.01 * np.eye(3)),
        "ids": replace(plain, landmark=np.arange(count)),
    }
    if not _stays(estimate, subject, plain):
        return frozenset()
    ignored: set[Need] = {need for need, changed in changes.items() if _stays(estimate, subject, changed)}
    shifted = replace(plain, observation=plain.observation + 10.0 * SIGMA * np.arange(count)[:, None])
    if ignored and _stays(estimate, subject, shifted):
        return frozenset()
    if "ids" in ignored and _run(subject, replace(plain, landmark=None)) is None:
        ignored.remove("ids")
    # one step with one observation, from the known start: the landmark's covariance is that of the noise
    rng = np.random.default_rng(SEED)
    once = replace(walk(rng, ahead(rng), steps=1), prior_cov=KNOWN_START, observed=((0, 0),))
    covs, map_covs = estimate.pose_covs, subject(once.recording()).landmark_covs
    if covs is not None and covs.max() < UNCERTAIN:
        ignored -= {"odometry noise"}
    if covs is not None and covs[0].max() < UNCERTAIN:
        ignored -= {"prior"}
    if map_covs is not None and len(map_covs) and map_covs.max() < UNCERTAIN:
        ignored -= {"observation noise"}
    return frozenset(ignored)


def _run(subject: Subject, recording: Recording) -> Estimate | None:
    """Return the estimate of a recording; None if the filter fails on it."""
    try:
        return subject(recording)
    except UserError:
        return None


def _stays(estimate: Estimate, subject: Subject, changed: Recording) -> bool:
    """Return whether poses and covariances of the changed recording are those of this estimate."""
    other = _run(subject, changed)
    return other is not None and all(
        np.array_equal(getattr(estimate, name), getattr(other, name))
        for name in ("poses", "pose_covs", "landmark_covs")
    )
