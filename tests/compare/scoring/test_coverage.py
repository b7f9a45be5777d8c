"""Coverage and log score against closed forms, of Gaussians whose covariance is right or wrong by a factor."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from slamgauge.arrays import Float
from slamgauge.compare.scoring.aggregation import FIRST_STEP
from slamgauge.compare.scoring.catalogue import STORED
from slamgauge.compare.scoring.coverage import is_inside, log_scores
from slamgauge.compare.scoring.runs import SERIES, Runs
from slamgauge.compare.scoring.scores import evaluate
from slamgauge.compare.studies.summary import summarise
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

STEPS = 20_000
COV = np.array([[0.04, 0.01, 0.002], [0.01, 0.09, -0.003], [0.002, -0.003, 0.0025]])


def recording() -> Recording:
    return Recording(
        stamps=np.arange(STEPS + 1.0),
        prior_mean=np.zeros(3),
        prior_cov=np.zeros((3, 3)),
        odometry=np.zeros((STEPS, 3)),
        odometry_cov=np.zeros((STEPS, 3, 3)),
        sensor="range-bearing",
        observation_step=np.zeros(0, dtype=np.int64),
        observation=np.zeros((0, 2)),
        observation_cov=np.zeros((0, 2, 2)),
        landmark=np.zeros(0, dtype=np.int64),
    )


def claimed(factor: float) -> Estimate:
    """The truth is the origin: errors are independent draws of COV, sigmas are claimed `factor` times too large."""
    errors = np.random.default_rng(7).multivariate_normal(np.zeros(3), COV, STEPS + 1)
    return Estimate(kind="filtered", poses=errors, pose_covs=np.tile(factor**2 * COV, (STEPS + 1, 1, 1)))


TRUTH = Truth(poses=np.zeros((STEPS + 1, 3)))


@pytest.mark.parametrize("factor", [1.0, 0.5, 2.0])
def test_ellipses_hold_as_many_as_the_rayleigh_distribution_says(factor: float):
    """1 - (1 - level)^factor^2 of the positions; two-sided 0.999 binomial bounds."""
    score = evaluate(TRUTH, recording(), claimed(factor))
    for level in (0.5, 0.95, 0.99):
        share = 1 - (1 - level) ** (factor**2)
        low, high = stats.binom.interval(0.999, STEPS + 1, share)
        assert low <= score.figure(f"coverage_{100 * level:.0f}") * (STEPS + 1) <= high


@pytest.mark.parametrize("factor", [1.0, 0.5, 2.0])
def test_the_mean_log_score_is_the_cross_entropy(factor: float):
    """Its entropy, 1/2 log det(2 pi e P), and what a wrong factor costs; variance 3/2 / factor^4 a step, 3.29 sigma."""
    found = evaluate(TRUTH, recording(), claimed(factor)).figure("log_score")
    entropy = np.linalg.slogdet(2 * math.pi * math.e * COV)[1] / 2
    cost = 3 * math.log(factor) + 1.5 * (factor**-2 - 1)
    assert abs(found - entropy - cost) <= 3.29 * math.sqrt(1.5 / STEPS) / factor**2
    assert cost >= 0  # proper: the right sigma has the least


def test_the_log_score_is_minus_the_log_density_whatever_the_units():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(20, 3, 3)) * [[1e4], [1.0], [1e-6]]
    covs, errors = A @ A.swapaxes(1, 2), np.einsum("nij,nj->ni", A, rng.normal(size=(20, 3)))
    units = np.array([1e-4, 1.0, 1e6])
    scaled = covs * units[:, None] * units
    expected = [-stats.multivariate_normal(cov=S).logpdf(e) for S, e in zip(scaled, errors * units, strict=True)]
    assert log_scores(errors, covs) == pytest.approx(np.array(expected) - np.log(units).sum(), rel=1e-6)


def test_what_has_no_density_has_no_score():
    covs = np.array([np.diag([1.0, 1, 0]), np.eye(3), np.full((3, 3), np.nan)])
    expected = [np.nan, 1.5 * math.log(2 * math.pi), np.nan]
    assert log_scores(np.zeros((3, 3)), covs) == pytest.approx(expected, nan_ok=True)
    assert is_inside(np.array([0.1, 5.9, 6.0, np.nan]), 0.95) == pytest.approx([1, 1, 0, np.nan], nan_ok=True)
    without = evaluate(None, recording(), claimed(1.0))
    assert (without.figure("coverage_95"), without.figure("log_score")) == (None, None)
    silent = Estimate(kind="filtered", poses=np.zeros((STEPS + 1, 3)))
    assert evaluate(TRUTH, recording(), silent, optimum=claimed(1.0)).log_score_to_optimum is None


def test_the_score_against_the_optimum_is_the_cost_of_the_wrong_sigma():
    score = evaluate(TRUTH, recording(), claimed(0.5), optimum=claimed(1.0))
    assert score.log_score_to_optimum == pytest.approx(
        score.figure("log_score") - evaluate(TRUTH, recording(), claimed(1.0)).figure("log_score")
    )
    assert score.log_score_to_optimum == pytest.approx(3 * math.log(0.5) + 4.5, abs=0.1)
    assert score.to_json()["coverage_95"] < 0.6


def stored(nees_position: Float, log_score: list[float]) -> Runs:
    undefined = np.full(nees_position.shape, np.nan)
    figures = {key: np.full(len(log_score), np.nan) for key in STORED}
    return Runs(
        run=np.arange(len(log_score)),
        kind="filtered",
        figures=figures | {"log_score": np.array(log_score)},
        series=dict.fromkeys(SERIES, undefined) | {"nees_position": nees_position},
    )


def test_a_study_has_the_share_of_the_late_steps_and_the_paired_score():
    nees = np.zeros((2, FIRST_STEP + 4))
    nees[:, :FIRST_STEP] = 1e9  # early steps do not count
    nees[0, FIRST_STEP] = 7.0
    summaries = summarise({"ekf": stored(nees, [-3.0, -2.0]), "causal": stored(nees, [-5.0, -5.0])})
    entry = summaries["ekf"].to_json()
    assert entry["coverage_95"]["mean"] == pytest.approx((3 / 4 + 1) / 2)
    assert entry["coverage_99"]["mean"] == 1.0
    assert entry["log_score"]["mean"] == -2.5
    assert entry["log_score_to_causal"]["mean"] == 2.5
