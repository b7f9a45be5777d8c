"""The consistency test without ground truth: its identities, its twins and its verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge.compare.scoring import without_truth
from slamgauge.compare.scoring.without_truth import ConsistencyTest, Figures, expected_nees, simulated_twins
from slamgauge.compare.storage.files import read_json, save
from slamgauge.ekf import riekf
from slamgauge.estimate import Estimate, Kind
from slamgauge.graph_baseline import batch
from slamgauge.sensors import innovation
from tests.reference.command_line import run
from tests.reference.given import given
from tests.reference.random_recordings import random_recording

pytestmark = pytest.mark.slow


def linear_filter_and_smoother(seed: int, steps: int = 40) -> tuple[Estimate, Estimate]:
    """Return filter and smoother of a random walk with position fixes, by conditioning their joint Gaussian."""
    rng = np.random.default_rng(seed)
    K, A = 0.01 * np.minimum.outer(*[np.arange(1, steps + 1)] * 2), 0.3 * rng.normal(size=(3, 3))
    z = np.cumsum(0.1 * rng.normal(size=(steps, 3)), axis=0) + 0.2 * rng.normal(size=(steps, 3))

    def estimate(kind: Kind, known: Sequence[int]) -> Estimate:
        """Return the estimate of each step from its number of known fixes."""
        gains = [np.linalg.solve(K[:n, :n] + 0.04 * np.eye(n), K[:n, row]) for row, n in enumerate(known)]
        means = np.array([gain @ z[: len(gain)] for gain in gains])
        variances = [K[row, row] - gain @ K[: len(gain), row] for row, gain in enumerate(gains)]
        return Estimate(kind, means @ A.T, np.multiply.outer(variances, A @ A.T))

    return estimate("filtered", range(1, steps + 1)), estimate("smoothed", [steps] * steps)


def test_means_of_a_linear_filter():
    """Means over 400 independent runs are within 4 standard deviations (false-alarm rate 1e-4) of their expectation."""
    ratios = np.array([expected_nees(*linear_filter_and_smoother(seed)).mean() / 3.0 for seed in range(400)])
    assert abs(ratios.mean() - 1.0) < 4.0 * ratios.std() / np.sqrt(len(ratios))


def test_covariances_that_are_too_small_singular_or_missing():
    filtered, smoothed = linear_filter_and_smoother(0)
    covs = given(filtered.pose_covs)
    quartered = expected_nees(replace(filtered, pose_covs=covs / 4.0), smoothed)
    assert_allclose(quartered, 4.0 * expected_nees(filtered, smoothed))
    singular = replace(filtered, pose_covs=np.where(np.arange(40)[:, None, None] < 2, 0.0, covs))
    assert_array_equal(np.isnan(expected_nees(singular, smoothed)), np.arange(40) < 2)
    assert np.isnan(expected_nees(replace(filtered, pose_covs=None), smoothed)).all()


@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
def test_a_twin_has_the_noise_that_the_log_states(sensor: str):
    _, recording = random_recording(2, sensor=sensor, steps=30)
    optimum = batch(recording)
    twins = list(simulated_twins(recording, optimum, 300))
    exactly = {"odometry_cov": 0 * recording.odometry_cov, "observation_cov": 1e-12 * recording.observation_cov}
    (exact,) = simulated_twins(replace(recording, **exactly), optimum, 1)
    moved = np.array([twin.odometry - exact.odometry for twin in twins])
    seen = np.array([innovation(sensor, twin.observation, exact.observation) for twin in twins])
    started = np.array([twin.prior_mean - optimum.poses[:1] for twin in twins])
    noise = ((started, recording.prior_cov[None]), (moved, recording.odometry_cov), (seen, recording.observation_cov))
    for errors, covs in noise:
        ratio = np.mean(errors**2 / np.diagonal(covs, axis1=1, axis2=2))
        assert abs(ratio - 1.0) < 4.0 * np.sqrt(2.0 / errors.size) * 1.5  # entries of one error are correlated


@pytest.mark.parametrize(
    ("means", "verdict", "text"),
    [
        ([1.0, 0.4, 0.9], "consistent", "consistent as far as this log shows, errors are about 1.00 times its sigmas"),
        ([2.0, 0.4, 0.9], "overconfident", "overconfident, errors are about 1.41 times its sigmas (p = 0.01)"),
        ([0.5, 0.4, 0.9], "too cautious", "too cautious, errors are about 0.71 times its sigmas (p = 0.01)"),
        ([1.0, 0.6, 0.9], "overconfident", "odometry residuals are 1.22 times those of twins (p = 0.01): Q is too"),
        ([1.0, 0.4, 0.7], "too cautious", "(p = 0.01): R is too large"),
        ([np.nan, 0.4, 0.9], "consistent", "not tested, because no step has an invertible covariance"),
        ([np.inf, 0.4, 0.9], "overconfident", "overconfident, errors are about inf times its sigmas"),
    ],
)
def test_verdicts(means: list[float], verdict: str, text: str):
    """The three figures of 99 twins are drawn independently around 1, 0.4 and 0.9."""
    twins = np.random.default_rng(0).normal([1.0, 0.4, 0.9], 0.03, (99, 3))
    found = ConsistencyTest(Figures(np.array(means), np.ones(1)), Figures(twins, np.ones((99, 1))))
    assert found.verdict == verdict
    assert text in found.text()


def test_level_of_three_exchangeable_figures():
    """Share of rejections in 2000 tests with 39 twins: within 4 standard deviations (false-alarm rate 1e-4) of 5 %."""
    draws = np.exp(np.random.default_rng(1).normal(size=(2000, 40, 3)))
    course = np.ones((39, 1))
    rejected = [ConsistencyTest(Figures(d[0], course[0]), Figures(d[1:], course)).p_values.min() <= 0.05 for d in draws]
    assert abs(np.mean(rejected) - 0.05) < 4.0 * np.sqrt(0.05 * 0.95 / 2000)


def test_a_wrong_filter_and_wrong_noise_on_a_recording():
    _, recording = random_recording(5, steps=60)
    small = replace(recording, odometry_cov=recording.odometry_cov / 25.0)
    for log, shrunk, verdict, text in (
        (recording, 1.0, "consistent", "consistent as far as this log shows"),
        (recording, 4.0, "overconfident", "overconfident, errors are about"),
        (small, 1.0, "overconfident", "Q is too small"),
    ):
        optimum, estimate = batch(log), riekf(log)
        twins = without_truth.figures_of({"": (riekf, None)}, simulated_twins(log, optimum, 19))[""]
        claimed = replace(estimate, pose_covs=given(estimate.pose_covs) / shrunk)
        found = ConsistencyTest(without_truth.figures(log, optimum, expected_nees(claimed, optimum)), twins)
        assert found.verdict == verdict
        assert text in found.text()


def test_evaluate_prints_the_verdict(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    _, recording = random_recording(5, steps=30)
    save(tmp_path / "recording.npz", recording)
    command = ("evaluate", tmp_path / "recording.npz", "--twins", 19, "--estimators")
    assert run(*command, "riekf,batch", "--no-report", "--out", tmp_path / "out") == 0
    assert "riekf: without ground truth: consistent as far as this log shows" in capsys.readouterr().out
    entry = read_json(tmp_path / "out/metrics.json")["without_truth"]["riekf"]
    assert len(entry["twins_high"]) == len(entry["time_s"]) == 31
    assert np.all(np.array(entry["twins_low"]) <= entry["twins_high"])
    assert (tmp_path / "out/consistency.png").exists()
    assert run(*command, "riekf") == 2
    assert "add batch to --estimators" in capsys.readouterr().err
    assert run(*command, "riekf,batch", "--twins", 9) == 2
    assert "9 are too few for a test of level 5%; give 19 or more" in capsys.readouterr().err
