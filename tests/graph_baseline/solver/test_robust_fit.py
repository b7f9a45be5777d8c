"""`robust_fit` finds misread ids, and long recordings with misread ids are not searched from all starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slamgauge import Recording, Truth, batch, load_scenario, simulate
from slamgauge.graph_baseline import hindsight
from slamgauge.graph_baseline.problem.preparation import in_frame_of_start, landmarks_at_median, prepare
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError
from slamgauge.graph_baseline.solver import multistart
from slamgauge.graph_baseline.solver.incremental import IncrementalOptimum
from slamgauge.graph_baseline.solver.isotropic_surrogate import surrogate_start
from slamgauge.graph_baseline.solver.levenberg_marquardt import damped_descent
from slamgauge.graph_baseline.solver.multistart import descent_start
from slamgauge.graph_baseline.solver.robust_fit import robust_fit
from slamgauge.se2 import rotation
from slamgauge.sensors import predict

STEPS = 300


@pytest.fixture(scope="module")
def run() -> tuple[Truth, Recording]:
    truth, recording = simulate(load_scenario("q1-short-dense"), 3)
    return truth, recording.first(STEPS)


def misread(recording: Recording, share: float) -> Recording:
    """Return the recording with a share of its ids replaced by random ids of its landmarks."""
    assert recording.landmark is not None
    rng, ids = np.random.default_rng(0), recording.landmark.copy()
    rows = rng.random(len(ids)) < share
    ids[rows] = rng.choice(np.unique(ids), int(rows.sum()))
    return replace(recording, landmark=ids)


def refuse(*_: object) -> None:
    raise AssertionError("a fourth start was tried")


def test_a_median_ignores_a_third_of_misread_ids(run: tuple[Truth, Recording]):
    truth, recording = run
    assert truth.poses is not None and truth.landmarks is not None and truth.landmark_ids is not None
    seen_from = truth.poses[recording.observation_step]
    seen = np.searchsorted(truth.landmark_ids, prepare(recording).landmark)
    offset = truth.landmarks[seen] - seen_from[:, :2]
    in_body = np.einsum("mji,mj->mi", rotation(seen_from[:, 2]), offset)
    problem = prepare(misread(replace(recording, observation=predict(recording.sensor, in_body)), 0.33))
    expected = truth.landmarks[np.searchsorted(truth.landmark_ids, problem.landmark_ids)]
    np.testing.assert_allclose(landmarks_at_median(problem, truth.poses[: STEPS + 1]), expected, atol=1e-9)


@pytest.mark.parametrize("share", [0.01, 0.1])
def test_misread_ids_are_outliers_and_few_others_are(run: tuple[Truth, Recording], share: float):
    wrong = misread(run[1], share)
    assert wrong.landmark is not None and run[1].landmark is not None
    bad = wrong.landmark != run[1].landmark
    outlier = ~robust_fit(prepare(in_frame_of_start(wrong))).inliers
    assert outlier[bad].mean() > 0.95
    assert outlier[~bad].mean() < 0.004  # 0.001 of correct observations exceed the limit


@pytest.mark.parametrize("share", [0.01, 0.1])
def test_a_long_recording_with_misread_ids_is_searched_from_three_starts(
    run: tuple[Truth, Recording], monkeypatch: pytest.MonkeyPatch, share: float
):
    for name in ("inflated_noise_start", "incremental_start", "growing_start"):
        monkeypatch.setattr(hindsight, name, refuse)
    found = batch(misread(run[1], share))
    assert found.chi_square is not None and found.chi_square_dof is not None
    assert found.chi_square > 2.0 * found.chi_square_dof


def test_the_start_without_dead_reckoning_finds_a_lower_minimum() -> None:
    truth, recording = simulate(load_scenario("tp4-handout", ["start=mean"]), 0)
    assert truth.association is not None
    wrong = prepare(in_frame_of_start(misread(recording.associated(truth.association), 0.1)))
    first = damped_descent(wrong, *descent_start(wrong, wrong.dead_reckoning)).cost
    fitted = damped_descent(wrong, *robust_fit(wrong)[:2]).cost
    assert damped_descent(wrong, *surrogate_start(wrong)).cost < 0.99 * min(first, fitted)


def test_a_residual_whose_square_overflows_is_an_outlier(run: tuple[Truth, Recording]):
    prepared = prepare(in_frame_of_start(run[1]))
    observation = prepared.observation.copy()
    observation[7, 0] = 1e200  # m
    with np.errstate(all="ignore"):  # no step has a finite cost
        assert not robust_fit(replace(prepared, observation=observation)).inliers[7]


def test_understated_noise_is_searched_from_two_starts_with_the_same_minimum(
    run: tuple[Truth, Recording], monkeypatch: pytest.MonkeyPatch
):
    recording = run[1]
    scale = 3.0**2
    stated = replace(
        recording,
        observation_cov=recording.observation_cov / scale,
        odometry_cov=recording.odometry_cov / scale,
        prior_cov=recording.prior_cov / scale,
    )
    expected = batch(recording)  # all covariances have the same factor, so the minimum is the same
    monkeypatch.setattr(multistart, "robust_fit", refuse)
    np.testing.assert_allclose(batch(stated).poses, expected.poses, atol=1e-6)


def test_an_incremental_start_that_switches_minima_too_often_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Odometry has a noise of 1 m a step: without the limit the start alone takes two minutes; `batch` needs none."""
    _, recording = simulate(load_scenario("q1-short-dense", ["start=mean", "motion.sigma_speed=10"]), 0)
    steps: list[int] = []
    add_step = IncrementalOptimum.add_step

    def counted(optimum: IncrementalOptimum) -> None:
        steps.append(1)
        add_step(optimum)

    monkeypatch.setattr(IncrementalOptimum, "add_step", counted)
    with pytest.raises(UndeterminedError, match="the first steps have many minima"):
        hindsight.incremental_start(prepare(in_frame_of_start(recording)), hindsight.MOST_SWITCHES)
    assert 0 < len(steps) < 0.25 * recording.steps
    steps.clear()
    assert batch(recording).chi_square == pytest.approx(15077.8760774380, rel=1e-9)
    assert not steps
