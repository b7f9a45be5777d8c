"""`robust_fit` finds misread ids, and understated noise is not searched from all starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slamgauge import Recording, Truth, batch, load_scenario, simulate
from slamgauge.graph_baseline import hindsight
from slamgauge.graph_baseline.problem.placement import landmarks_at_median
from slamgauge.graph_baseline.problem.preparation import in_frame_of_start, prepare
from slamgauge.graph_baseline.solver.robust_fit import outlier_limit, robust_fit
from slamgauge.se2 import rotation
from slamgauge.sensors import predict

pytestmark = pytest.mark.slow

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
    problem = prepare(in_frame_of_start(wrong))
    outlier = robust_fit(problem).squared >= outlier_limit(problem)
    assert outlier[bad].mean() > 0.95
    assert outlier[~bad].mean() < 0.004  # 0.001 of correct observations exceed the limit


def test_a_residual_whose_square_overflows_is_an_outlier(run: tuple[Truth, Recording]):
    prepared = prepare(in_frame_of_start(run[1]))
    observation = prepared.observation.copy()
    observation[7, 0] = 1e200  # m
    with np.errstate(all="ignore"):  # no step has a finite cost
        squared = robust_fit(replace(prepared, observation=observation)).squared
    assert squared[7] > outlier_limit(prepared)


def test_understated_noise_is_searched_from_two_starts_and_explained_noise_from_one(
    run: tuple[Truth, Recording], monkeypatch: pytest.MonkeyPatch
):
    recording, tried = run[1], list[str]()
    of_outliers = hindsight.robust_fit
    monkeypatch.setattr(hindsight, "robust_fit", lambda given: (tried.append("second"), of_outliers(given))[1])
    monkeypatch.setattr(hindsight, "incremental_start", lambda _: tried.append("third"))
    expected = batch(recording)
    for variance, starts in ((10.0, []), (1.0 / 9.0, ["second"])):
        covs = {name: getattr(recording, name) * variance for name in ("observation_cov", "odometry_cov", "prior_cov")}
        found = batch(replace(recording, **covs))  # all covariances have the same factor, so the minimum is the same
        np.testing.assert_allclose(found.poses, expected.poses, atol=1e-6)
        assert tried == starts
