"""Limits of double precision are reported in one line; singular covariances are accepted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.ekf import ekf_slam, fej_ekf, iekf, oc_ekf, riekf
from slamgauge.ekf.kernels.soundness import are_sound, is_semidefinite
from slamgauge.ekf.maps.input_checks import without_rounding
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS as TABLE
from slamgauge.validation import as_covariances
from tests.reference.random_recordings import random_covariances, random_recording

FILTERS = pytest.mark.parametrize("estimator", [ekf_slam, fej_ekf, oc_ekf, iekf, riekf])
SENSORS = pytest.mark.parametrize("sensor", ["range-bearing", "position"])
Estimator = Callable[..., Estimate]
FAR_APART = r"^(observation|pose_covs)[^\n]*too far apart for double precision[^\n]*$"


def with_sigmas(recording: Recording, prior: Float, motion: Float, sight: Float) -> Recording:
    """Return the same values with other standard deviations: (3,), (3,), and one for every step (N+1,)."""
    return replace(
        recording,
        prior_cov=np.diag(prior) ** 2,
        odometry_cov=np.tile(np.diag(motion) ** 2, (recording.steps, 1, 1)),
        observation_cov=np.eye(2) * sight[recording.observation_step, None, None] ** 2,
    )


SMALL, LARGE, USUAL = np.full(11, 1e-7), np.where(np.arange(11) < 4, 1e6, 1e-7), np.array([0.1, 0.1, 0.1])
FAR = np.array([1e6, 1e6, 0.1])


@FILTERS
@SENSORS
@pytest.mark.parametrize(
    ("prior", "motion", "sight"),
    [
        pytest.param(FAR, USUAL, SMALL, id="prior"),
        pytest.param(USUAL, FAR, SMALL, id="motion"),
        pytest.param(np.zeros(3), FAR, SMALL, id="motion from a known start"),
        pytest.param(USUAL, USUAL, LARGE, id="sights"),
    ],
)
def test_sigmas_of_1e6_and_1e_minus_7_give_a_result_or_an_error(
    estimator: Estimator, sensor: str, prior: Float, motion: Float, sight: Float
) -> None:
    _, recording = random_recording(3, sensor=sensor, steps=10, landmarks=4, noise=0.01)
    recording = with_sigmas(recording, prior, motion, sight)
    with pytest.raises(UserError, match=FAR_APART):
        estimator(recording)


LINES = [[1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.3, 0.1, -0.2]]
PRIORS = [np.zeros(3), np.array([1.0, 0.0, 0.0]), np.array([1e4, 1e4, 0.1])]
MOTIONS = [np.zeros(3), np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.0, 0.1])]
SINGULAR = [
    *((prior, np.diag(motion) ** 2, 0.01) for prior in PRIORS for motion in MOTIONS),
    *((np.zeros(3), np.outer(line, line), 1e-4) for line in LINES),  # singular except for rounding: 1 m^2 after 0.1 mm
]


@FILTERS
@SENSORS
@pytest.mark.parametrize(("prior", "motion_cov", "sight"), SINGULAR)
def test_singular_covariances_are_accepted(
    estimator: Estimator, sensor: str, prior: Float, motion_cov: Float, sight: float
) -> None:
    _, recording = random_recording(3, sensor=sensor, steps=10, landmarks=4, noise=sight)
    recording = with_sigmas(recording, prior, np.zeros(3), np.full(11, sight))
    estimate = estimator(replace(recording, odometry_cov=np.tile(motion_cov, (recording.steps, 1, 1))))
    assert estimate.pose_covs is not None
    assert (np.diagonal(estimate.pose_covs, axis1=1, axis2=2) >= 0.0).all()
    assert np.isfinite(estimate.poses).all()


def test_only_rounding_is_removed_from_a_covariance() -> None:
    line = np.array([1e-3, 1.0, 20.0])
    singular = np.outer(line, line)
    rounded = singular + np.diag([-1e-8, 0.0, 0.0]) * singular
    covs = np.stack([np.eye(3), rounded, singular])
    mended = without_rounding("pose_covs", covs)
    np.testing.assert_array_equal(mended[[0, 2]], covs[[0, 2]])
    np.testing.assert_allclose(mended[1], singular, rtol=1e-7)
    correlations = mended[1] / np.sqrt(np.outer(np.diag(mended[1]), np.diag(mended[1])))
    assert np.linalg.eigvalsh(correlations)[0] > -1e-14
    with pytest.raises(UserError, match=r"^pose_covs\[0\][^\n]*too far apart"):
        without_rounding("pose_covs", (singular + np.diag([-0.1, 0.0, 0.0]) * singular)[None])
    with pytest.raises(UserError, match=r"^pose_covs\[1\][^\n]*has diverged"):
        without_rounding("pose_covs", np.stack([np.eye(3), np.full((3, 3), np.nan)]))


# --- the kernels accept the covariances that recordings may have, and refuse indefinite matrices --


def spoiled(rng: np.random.Generator, dim: int) -> Float:
    """Return a nearly valid covariance: with rounding errors, zero variances, or invalid entries."""
    root = rng.normal(size=(dim, int(rng.integers(1, dim + 1)))) * 10 ** rng.uniform(-6, 3, (dim, 1))
    root[rng.random(dim) < 0.3] = 0.0
    P, noise = root @ root.T, rng.normal(size=(dim, dim)) * 10 ** rng.uniform(-14, -3)
    noise += noise.T if rng.random() < 0.7 else 0.0
    scale = np.sqrt(np.outer(np.diag(P), np.diag(P))) if rng.random() < 0.5 else 1.0
    return P + noise * scale * (rng.random((dim, dim)) < 0.5)


def is_taken(P: Float, *, definite: bool) -> bool:
    try:
        as_covariances("P", P[None], (1, *P.shape), definite=definite)
    except UserError:
        return False
    return True


def test_kernels_accept_all_covariances_of_recordings() -> None:
    """The kernels accept all that `validation` accepts, and refuse most of those that it refuses."""
    rng, taken, refused = np.random.default_rng(0), 0, 0
    for _ in range(5000):
        Q, R = spoiled(rng, 3), spoiled(rng, 2)
        good = is_taken(Q, definite=False)
        assert is_semidefinite(Q) or not good
        assert are_sound(TABLE["range-bearing"].code, np.ones((1, 2)), R[None]) or not is_taken(R, definite=True)
        taken, refused = taken + good, refused + (not good and not is_semidefinite(Q))
    assert taken > 1000
    assert refused > 1000
    assert taken + refused > 4500


def test_indefinite_matrices_are_distinguished_from_covariances() -> None:
    rng = np.random.default_rng(1)
    for _ in range(1000):
        Q = random_covariances(rng, 1, 10 ** rng.uniform(-4, 1, 3))[0]
        assert is_semidefinite(Q)
        values, vectors = np.linalg.eigh(Q)
        assert not is_semidefinite(vectors @ np.diag([*values[:2], -values[2]]) @ vectors.T)
