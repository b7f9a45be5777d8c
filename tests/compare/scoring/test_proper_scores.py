"""CRPS, energy score, PIT histogram and bootstrap: against integrals, closed forms and smfeval."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats

from slamgauge.arrays import Float
from slamgauge.compare.scoring.proper_scores import (
    SHORTEST,
    ate_interval,
    block_length,
    bootstrap_means,
    crps,
    energy_scores,
    mean_crps,
    mean_energy_score,
    mean_within_run,
    pit_histogram,
)
from slamgauge.estimate import Estimate
from slamgauge.truth import Truth

from .builders import straight


def ar1(phi: float, count: int, seed: int = 0) -> Float:
    """Return a stationary AR(1) series (count,) of variance 1."""
    noise = np.random.default_rng(seed).normal(scale=math.sqrt(1 - phi**2), size=count)
    series = np.empty(count)
    series[0] = noise[0] / math.sqrt(1 - phi**2)
    for i in range(1, count):
        series[i] = phi * series[i - 1] + noise[i]
    return series


@pytest.mark.parametrize(("error", "sigma"), [(0.0, 1.0), (0.3, 0.1), (-2.0, 0.7), (5.0, 0.02)])
def test_crps_is_its_integral(error: float, sigma: float):
    """The truth is 0, the estimate `error`."""
    ends = (min(0.0, error) - 10 * sigma, max(0.0, error) + 10 * sigma)

    def square(x: float) -> float:
        return (float(stats.norm.cdf(x, error, sigma)) - (x >= 0.0)) ** 2

    expected = sum(integrate.quad(square, *part, limit=400)[0] for part in ((ends[0], 0.0), (0.0, ends[1])))
    assert crps(np.array([error]), np.array([sigma]))[0] == pytest.approx(expected, rel=1e-7)


def test_without_uncertainty_the_scores_are_the_error():
    errors = np.array([[3.0, -4.0]])
    assert crps(errors, np.zeros((1, 2))).tolist() == [[3.0, 4.0]]
    assert energy_scores(errors, np.zeros((1, 2, 2))) == pytest.approx([5.0], rel=2e-3)


def test_energy_score_in_closed_form():
    """Isotropic, truth at the mean: E|X| = sigma sqrt(pi / 2), E|X - X'| = sqrt(2) E|X|. A line: the CRPS along it."""
    expected = 0.7 * math.sqrt(math.pi / 2) * (1 - math.sqrt(2) / 2)
    assert energy_scores(np.zeros((1, 2)), 0.49 * np.eye(2)[None])[0] == pytest.approx(expected, rel=1e-12)
    along = crps(np.array([0.5]), np.array([0.3]))
    line = energy_scores(np.array([[0.5, 0.0]]), np.array([np.diag([0.09, 0.0])]))
    assert line == pytest.approx(along, rel=2e-3)


def test_energy_score_of_samples():
    rng = np.random.default_rng(0)
    A = np.array([[1.0, 0.0], [0.5, 0.2]])
    X, other, truth = rng.normal(size=(400_000, 2)) @ A.T, rng.normal(size=(400_000, 2)) @ A.T, np.array([0.4, -0.6])
    expected = np.linalg.norm(X - truth, axis=1).mean() - np.linalg.norm(X - other, axis=1).mean() / 2
    assert energy_scores(-truth[None], (A @ A.T)[None])[0] == pytest.approx(expected, rel=0.01)


def test_scores_equal_those_of_smfeval():
    """Its third axis has neither error nor variance, and its energy score is sampled."""
    scoring = pytest.importorskip("smfeval.scoring.crps")
    energy = pytest.importorskip("smfeval.scoring.energy")
    step_of = pytest.importorskip("smfeval.steps").GaussianStep
    rng, places = np.random.default_rng(1), np.zeros(3)
    for _ in range(5):
        A, error = rng.normal(size=(2, 2)), rng.normal(size=2)
        cov = np.zeros((6, 6))
        cov[:2, :2], cov[2, 2] = A @ A.T, 1e-24
        step = step_of(0.0, np.append(error, 0.0), np.array([0.0, 0.0, 0.0, 1.0]), cov)
        ours = crps(error, np.sqrt(np.diag(A @ A.T))).mean()
        assert 2 / 3 * ours == pytest.approx(scoring.translation_crps(step, places), rel=1e-9)
        sampled = energy.energy_score(step, places, n_samples=2000)
        assert energy_scores(error[None], (A @ A.T)[None])[0] == pytest.approx(sampled, rel=0.05)


@pytest.mark.parametrize("phi", [0.3, 0.7, 0.9])
def test_block_length_of_an_autoregressive_series(phi: float):
    """Its sums of autocovariances are known: G / g = 2 phi / (1 - phi^2). smfeval stops at the next lag."""
    count = 20_000
    expected = (count * (2 * phi / (1 - phi**2)) ** 2) ** (1 / 3)
    lengths = [block_length(ar1(phi, count, seed)) for seed in range(5)]
    assert np.mean(lengths) == pytest.approx(expected, rel=0.15)
    summary = pytest.importorskip("smfeval.scoring.summary")
    theirs = [summary.politis_white_block_length(ar1(phi, count, seed)) for seed in range(5)]
    assert np.mean(lengths) == pytest.approx(np.mean(theirs), rel=0.15)


def test_short_blocks_for_white_and_constant_series():
    assert block_length(np.ones(100)) == 1.0
    white = [block_length(np.random.default_rng(seed).normal(size=2000)) for seed in range(20)]
    assert np.median(white) < 5


def test_bootstrap_of_blocks_of_one_is_that_of_independent_values():
    values = np.random.default_rng(0).normal(size=400)
    means = bootstrap_means(values, 1.0)
    assert means.mean() == pytest.approx(values.mean(), abs=0.01)
    assert means.std() == pytest.approx(values.std() / 20, rel=0.15)
    whole = bootstrap_means(values, 1e9)  # a single block that goes round: always the mean
    assert whole == pytest.approx(np.full(len(whole), values.mean()))


@pytest.mark.full  # a statistic of many series
def test_the_interval_contains_the_mean_of_a_correlated_series():
    """Of 200 series 180 do, and at least 170 must; an interval for independent values contains 97."""
    inside = 0
    for seed in range(200):
        ends = mean_within_run(ar1(0.8, 1000, seed))
        assert ends is not None
        inside += ends[0] < 0.0 < ends[1]
    assert inside >= 170


def test_without_what_they_need_there_are_no_scores():
    recording = straight(50)
    estimate = Estimate(kind="filtered", poses=np.zeros((51, 3)))
    truth = Truth(poses=np.zeros((51, 3)))
    assert mean_within_run(np.ones(SHORTEST - 1)) is None
    assert ate_interval(Truth(), recording, estimate) is None
    assert ate_interval(truth, recording, estimate) == [0.0, 0.0]
    for score in (mean_crps, mean_energy_score, pit_histogram):
        assert score(truth, recording, estimate) is None
        assert score(Truth(), recording, replace(estimate, pose_covs=np.tile(np.eye(3), (51, 1, 1)))) is None


def test_pit_histogram_is_flat_if_the_covariance_is_right():
    steps, sigma = 20_000, 0.3
    poses = np.zeros((steps + 1, 3))
    poses[:, :2] = sigma * np.random.default_rng(0).normal(size=(steps + 1, 2))
    covs = np.tile(sigma**2 * np.eye(3), (steps + 1, 1, 1))
    truth = Truth(poses=np.zeros((steps + 1, 3)))
    shares = pit_histogram(truth, straight(steps), Estimate(kind="filtered", poses=poses, pose_covs=covs))
    assert shares == pytest.approx(np.full(10, 0.1), abs=0.01)
    sure = pit_histogram(truth, straight(steps), Estimate(kind="filtered", poses=poses, pose_covs=covs / 4))
    assert sure is not None
    assert sure[-1] > 0.5
