"""The recordings that `benchmarks/agreement.py` draws state their own noise, and its references are right."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from scipy.stats import chi2

from slamgauge.arrays import Float
from slamgauge.estimate import Estimate, Estimator
from slamgauge.graph_baseline import batch, causal
from slamgauge.recording import Recording
from slamgauge.se2 import between, log, rotation, wrap
from tests.reference import agreement, optimum_agreement
from tests.reference.agreement import PAIRS, Outcome, judge_filter, judge_filters, table
from tests.reference.drawn_recordings import MOTIONS, PRIORS, SENSORS, Drawn, draw
from tests.reference.given import given
from tests.reference.least_squares import Model, square_root
from tests.reference.optimum_agreement import judge_optima
from tests.reference.random_recordings import random_recording

pytestmark = pytest.mark.full  # references of a benchmark; tests/reference has those of the other tests

FALSE_ALARM = 1e-4  # rate of each two-sided chi-square test


@cache
def drawn(number: int) -> Drawn:
    return draw(7, number)


def drawn_with(*tags: str) -> Drawn:
    """Return the first recording with these tags and more than 30 observations."""
    return next(
        each for each in map(drawn, range(300)) if {*tags} <= {*each.tags} and len(each.recording.observation) > 30
    )


def test_all_kinds_are_drawn_and_each_recording_can_be_made_alone():
    assert (draw(7, 5).recording, draw(7, 5).truth) == (drawn(5).recording, drawn(5).truth)
    assert drawn(5).recording not in (draw(7, 2).recording, draw(8, 5).recording)
    recordings = [drawn(number).recording for number in range(300)]
    kinds = {f"motion {kind}" for kind in (*MOTIONS, "mixed")} | {f"prior {kind}" for kind in PRIORS}
    found = {tag for number in range(300) for tag in drawn(number).tags}
    assert found == {*SENSORS, "additive", "exponential"} | kinds
    steps = [each.steps for each in recordings]
    assert min(steps) == 2 and max(steps) > 90
    assert min(len(each.observation) for each in recordings) == 0
    assert max(np.abs(each.prior_mean).max() for each in recordings) > 5e4
    assert any(not each.odometry_cov.any(axis=(1, 2)).all() for each in recordings)


def noise_of(each: Drawn) -> Iterator[tuple[str, Float, Float]]:
    """Yield every drawn noise with the covariance that the recording states."""
    recording, truth = each.recording, each.truth
    path, places = given(truth.poses), given(truth.landmarks)
    start = path[0] - recording.prior_mean
    yield "start", np.append(start[:2], wrap(start[2])), recording.prior_cov
    moves = between(path[:-1], path[1:])
    noise = moves - recording.odometry if "additive" in each.tags else log(between(recording.odometry, moves))
    noise[:, 2] = wrap(noise[:, 2])
    for own, cov in zip(noise, recording.odometry_cov, strict=True):
        yield "motion", own, cov
    pose = path[recording.observation_step]
    delta = np.einsum("mji,mj->mi", rotation(pose[:, 2]), places[given(recording.landmark)] - pose[:, :2])
    polar = np.column_stack([np.hypot(*delta.T), np.arctan2(*delta.T[::-1])])
    exact = delta if recording.sensor == "position" else polar
    error = recording.observation - exact[:, -recording.observation.shape[1] :]
    if recording.sensor != "position":
        error[:, -1] = wrap(error[:, -1])
    for own, cov in zip(error, recording.observation_cov, strict=True):
        yield recording.sensor, own, cov


def test_every_recording_is_drawn_from_the_noise_that_it_states():
    """Two-sided, for start, motion and each sensor; all noise is in the column space of its covariance."""
    kinds = ("start", "motion", *SENSORS)
    squares, freedom = dict.fromkeys(kinds, 0.0), dict.fromkeys(kinds, 0)
    for number in range(300):
        for kind, noise, cov in noise_of(drawn(number)):
            root = square_root(cov)
            white = np.linalg.pinv(root) @ noise
            assert np.abs(noise - root @ white).max() < 1e-9  # spacing of doubles at 100 km is 1.5e-11 m
            squares[kind] += float(white @ white)
            freedom[kind] += root.shape[1]
    for kind, square in squares.items():
        assert freedom[kind] > 300
        assert FALSE_ALARM / 2 < chi2.cdf(square, freedom[kind]) < 1 - FALSE_ALARM / 2, kind


@pytest.mark.parametrize("number", range(12))
def test_least_squares_has_the_jacobian_of_its_residuals(number: int):
    """Central differences, along a random direction."""
    each = drawn(number)
    model = Model(each.recording)
    at = model.start(model.relative(given(each.truth.poses)))
    direction = 1e-6 * np.random.default_rng(number).normal(size=model.size)
    expected = (model.residuals(at + direction) - model.residuals(at - direction)) / 2
    atol = 1e-6 * np.abs(expected).max(initial=1e-9)
    np.testing.assert_allclose(model.jacobian(at) @ direction, expected, atol=atol)


def shifted(estimate: Estimate, sigmas: float) -> Estimate:
    """Return an estimate with poses shifted by a number of their sigmas."""
    sigma = np.sqrt(np.diagonal(given(estimate.pose_covs), axis1=1, axis2=2))
    return replace(estimate, poses=estimate.poses + sigmas * sigma)


@pytest.mark.parametrize("name", PAIRS)
def test_a_filter_with_an_error_of_two_millionths_of_a_sigma_is_detected(name: str, monkeypatch: pytest.MonkeyPatch):
    _, recording = random_recording(1, steps=25)
    assert judge_filter(recording, name).verdict == "agrees"
    ours, textbook = PAIRS[name]
    monkeypatch.setitem(agreement.PAIRS, name, (lambda recording: shifted(ours(recording), 2e-6), textbook))
    assert judge_filter(recording, name).verdict == "worse"


def test_an_optimum_with_an_error_of_half_a_sigma_is_detected(monkeypatch: pytest.MonkeyPatch):
    each = drawn_with("position", "motion full")
    right = {outcome.estimator: outcome for outcome in judge_optima(each)}
    assert right["batch"].verdict == "agrees"
    assert right["causal"].steps == each.recording.steps + 1

    def wrong(optimum: Estimator, recording: Recording) -> Estimate:
        return shifted(optimum(recording), 0.5)

    for optimum in (batch, causal):
        monkeypatch.setattr(optimum_agreement, optimum.__name__, partial(wrong, optimum))
    found = {outcome.estimator: outcome for outcome in judge_optima(each)}
    assert found["batch"].verdict == "worse"
    assert found["causal"].steps_off > 0.9 * each.recording.steps
    assert found["causal"].difference > 0.3


def test_the_table_counts_verdicts_and_bearing_only_filters_have_no_reference():
    outcomes = [Outcome("ekf", "worse", 10.0**-k) for k in range(5)]
    outcomes += [Outcome("ekf", "failed", np.inf, "no covariance"), Outcome("ekf", "agrees", 1e-9)]
    assert table(outcomes).splitlines()[1].split() == ["ekf", "1", "5", "1", "0", "0", "1.0e+00", "sigma"]
    each = next(d for d in map(drawn, range(300)) if "bearing" in d.tags and d.recording.steps < 10)
    assert {outcome.verdict for outcome in judge_filters(each.recording)} == {"not compared"}
