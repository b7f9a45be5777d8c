"""The recordings that `benchmarks/agreement.py` draws state their own noise, and its references are right."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from slamgauge.arrays import Float
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import between, rotation, wrap
from tests.reference.agreement import Judged, Outcome, table
from tests.reference.drawn_recordings import MOTIONS, PRIORS, SENSORS, Drawn, draw
from tests.reference.filter_agreement import PAIRS, judge_filter, judge_filters, judge_minimum
from tests.reference.least_squares import Model, NoMinimumError, square_root
from tests.reference.optimum_agreement import judge_optima
from tests.reference.random_recordings import random_recording

pytestmark = pytest.mark.full  # references of a benchmark; tests/reference has those of the other tests

FALSE_ALARM = 1e-4  # rate of each two-sided chi-square test


@cache
def drawn(number: int) -> Drawn:
    return draw(7, number)


# --- the recordings ----------------------------------------------------------------------------------


def test_a_recording_can_be_made_alone():
    for number in (0, 5, 17):
        again = draw(7, number)
        assert again.recording == drawn(number).recording
        assert again.truth == drawn(number).truth
        assert again.tags == drawn(number).tags
    assert draw(7, 1).recording != draw(7, 2).recording
    assert draw(7, 1).recording != draw(8, 1).recording


def test_all_kinds_are_drawn():
    found = {tag for number in range(300) for tag in drawn(number).tags}
    kinds = {f"motion {kind}" for kind in (*MOTIONS, "mixed", "zero in steps")} | {f"prior {kind}" for kind in PRIORS}
    others = {"additive", "exponential", "far", "clusters", "twice in a scan", "blind stretch", "close", "nothing seen"}
    assert found == {*SENSORS} | kinds | others
    steps = [drawn(number).recording.steps for number in range(300)]
    assert min(steps) == 2
    assert max(steps) > 90


def test_tags_are_true():
    for number in range(100):
        recording, tags = drawn(number).recording, drawn(number).tags
        assert recording.landmark is not None
        assert recording.sensor == tags[0]
        sights = np.column_stack([recording.observation_step, recording.landmark])
        assert (len(np.unique(sights, axis=0)) < len(sights)) == ("twice in a scan" in tags)
        assert (np.abs(recording.prior_mean[:2]).max() > 100.0) == ("far" in tags)
        assert (not recording.prior_cov.any()) == ("prior zero" in tags)
        assert (len(recording.observation) == 0) == ("nothing seen" in tags)


def noise_of(each: Drawn) -> Iterator[tuple[str, Float, Float]]:
    """Yield every drawn noise with the covariance that the recording states."""
    recording, truth = each.recording, each.truth
    assert truth.poses is not None and truth.landmarks is not None and recording.landmark is not None
    start = truth.poses[0] - recording.prior_mean
    yield "start", np.append(start[:2], wrap(start[2])), recording.prior_cov
    moves = between(truth.poses[:-1], truth.poses[1:])
    for odometry, move, cov in zip(recording.odometry, moves, recording.odometry_cov, strict=True):
        if "additive" in each.tags:
            yield "motion", np.append((move - odometry)[:2], wrap(move[2] - odometry[2])), cov
        else:
            yield "motion", log_se2(between(odometry, move)), cov
    pose = truth.poses[recording.observation_step]
    delta = np.einsum("mji,mj->mi", rotation(pose[:, 2]), truth.landmarks[recording.landmark] - pose[:, :2])
    exact = (
        delta if recording.sensor == "position" else np.column_stack([np.hypot(*delta.T), np.arctan2(*delta.T[::-1])])
    )
    error = recording.observation - exact[:, -recording.observation.shape[1] :]
    if recording.sensor != "position":
        error[:, -1] = wrap(error[:, -1])
    for own, cov in zip(error, recording.observation_cov, strict=True):
        yield recording.sensor, own, cov


def log_se2(increment: Float) -> Float:
    """Logarithm, by solving V(t) v = p."""
    t = increment[2]
    s, c = np.sinc(t / np.pi), (1 - np.cos(t)) / t if t else 0.0
    return np.array([*np.linalg.solve(np.array([[s, -c], [c, s]]), increment[:2]), t], dtype=np.float64)


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


# --- the references ------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", range(12))
def test_least_squares_has_the_jacobian_of_its_residuals(number: int):
    """Central differences, along a random direction."""
    each = drawn(number)
    model = Model(each.recording)
    assert each.truth.poses is not None
    at = model.start(model.relative(each.truth.poses))
    direction = 1e-6 * np.random.default_rng(number).normal(size=model.size)
    expected = (model.residuals(at + direction) - model.residuals(at - direction)) / 2
    atol = 1e-6 * np.abs(expected).max(initial=1e-9)
    np.testing.assert_allclose(model.jacobian(at) @ direction, expected, atol=atol)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("motion", [*MOTIONS])
def test_least_squares_finds_the_truth_where_there_is_no_noise(sensor: str, motion: str):
    """With exact measurements and the stated, possibly singular noise the minimum is the truth and its cost is 0."""
    each = next(
        d
        for d in map(drawn, range(300))
        if {sensor, f"motion {motion}"} <= {*d.tags} and len(d.recording.observation) > 30
    )
    assert each.truth.poses is not None and each.truth.landmarks is not None
    recording = replace(each.recording, prior_mean=each.truth.poses[0])
    moves = between(each.truth.poses[:-1], each.truth.poses[1:])
    recording = replace(recording, odometry=moves)
    model = Model(recording)
    true = model.unknowns(model.relative(each.truth.poses), model.relative(each.truth.landmarks[model.ids]))
    exact = model.residuals(true)[model.noises :].reshape(recording.observation.shape)
    errors = np.linalg.solve(model.whitener, exact[..., None])[..., 0]
    model = Model(replace(recording, observation=recording.observation + errors))
    assert model.cost(true) < 1e-9
    shaken = true + np.concatenate([np.full(model.noises, 0.1), np.full(len(true) - model.noises, 1e-4)])
    try:
        found = model.minimum(shaken)
    except NoMinimumError:  # bearings that place nothing
        assert sensor == "bearing"
        return
    assert found.cost < 1e-9
    np.testing.assert_allclose(found.unknowns[: model.noises], 0.0, atol=1e-3)


@pytest.mark.parametrize("name", PAIRS)
def test_a_wrong_filter_is_detected(name: str, monkeypatch: pytest.MonkeyPatch):
    """Poses are shifted by two millionths of a sigma."""
    _, recording = random_recording(1, steps=25)
    assert judge_filter(recording, name).verdict == "agrees"
    pair = PAIRS[name]

    def shifted(recording: Recording) -> Estimate:
        estimate = pair.ours(recording)
        assert estimate.pose_covs is not None
        sigma = np.sqrt(np.diagonal(estimate.pose_covs, axis1=1, axis2=2))
        return replace(estimate, poses=estimate.poses + 2e-6 * sigma)

    monkeypatch.setitem(PAIRS, name, pair._replace(ours=shifted))
    assert judge_filter(recording, name).verdict == "worse"


@pytest.mark.parametrize("number", [612, 1553])
def test_the_iterated_filter_ends_at_the_minimum_that_it_has_found(number: int):
    """The linear update to the minimum has lost digits there."""
    assert judge_minimum(draw(2028, number).recording).difference < 1e-7


def test_a_minimum_that_rounding_of_the_covariance_hides_is_undecided():
    assert judge_minimum(draw(2028, 737).recording).verdict == "undecided"


def test_one_pass_is_not_the_minimum_of_the_iterated_filter():
    _, recording = random_recording(2, steps=15)
    assert judge_minimum(recording, "iterated").verdict == "agrees"
    one_pass = judge_minimum(recording, "standard")
    assert one_pass.verdict == "worse"
    assert one_pass.difference > 1e-4


def test_a_wrong_optimum_is_detected(monkeypatch: pytest.MonkeyPatch):
    """`batch` and `causal` return poses that are shifted by half a sigma."""
    each = next(
        d
        for d in map(drawn, range(300))
        if {"position", "motion full"} <= {*d.tags} and len(d.recording.observation) > 30
    )
    right = {outcome.estimator: outcome for outcome in judge_optima(each)}
    assert right["batch"].verdict == "agrees"
    assert right["causal"].steps == each.recording.steps + 1
    for name in ("batch", "causal"):
        theirs = getattr(sys.modules["tests.reference.optimum_agreement"], name)

        def shifted(recording: object, theirs: object = theirs) -> Estimate:
            estimate = theirs(recording)  # pyrefly: ignore[not-callable]
            sigma = np.sqrt(np.diagonal(estimate.pose_covs, axis1=1, axis2=2))
            return replace(estimate, poses=estimate.poses + 0.5 * sigma)

        monkeypatch.setattr(f"tests.reference.optimum_agreement.{name}", shifted)
    wrong = {outcome.estimator: outcome for outcome in judge_optima(each)}
    assert wrong["batch"].verdict == "worse"
    assert wrong["causal"].steps_off > 0.9 * each.recording.steps
    assert wrong["causal"].difference > 0.3


# --- the table ---------------------------------------------------------------------------------------


def judged(*outcomes: Outcome, number: int = 0) -> Judged:
    return Judged(1, number, 10, ("position",), [*outcomes], 0.1)


def test_the_table_counts():
    rows = [judged(Outcome("ekf", "worse", 10.0**-k), number=k) for k in range(5)]
    rows += [judged(Outcome("ekf", "failed", np.inf, "no covariance")), judged(Outcome("ekf", "agrees", 1e-9))]
    line = table(rows).splitlines()[1].split()
    assert line == ["ekf", "1", "5", "1", "0", "0", "1.0e+00", "sigma"]


def test_bearing_only_filters_have_no_reference_and_must_run():
    each = next(d for d in map(drawn, range(300)) if "bearing" in d.tags and d.recording.steps < 10)
    assert {outcome.verdict for outcome in judge_filters(each.recording)} == {"not compared"}
