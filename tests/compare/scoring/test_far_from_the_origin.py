"""Scores do not depend on the place of a run in the world: robots log UTM positions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scoring.measured import Measured
from slamgauge.compare.scoring.scores import evaluate
from slamgauge.compare.studies.study_run import step_series
from slamgauge.ekf import ekf_slam, riekf
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth
from tests.reference.given import given

FAR = np.array([500_000.0, 4_600_000.0, 0.0])  # [m]: UTM coordinates of southern Europe
SAME = 1e-6


def far_estimate(estimate: Estimate) -> Estimate:
    history = estimate.history
    if history is not None:
        history = replace(history, position=history.position + FAR[:2])
    landmarks = estimate.landmarks + FAR[:2] if len(estimate.landmark_ids) else estimate.landmarks
    return replace(estimate, poses=estimate.poses + FAR, landmarks=landmarks, history=history)


def far_run(truth: Truth, recording: Recording) -> tuple[Truth, Recording]:
    moved = replace(truth, poses=given(truth.poses) + FAR, landmarks=given(truth.landmarks) + FAR[:2])
    return moved, replace(recording, prior_mean=recording.prior_mean + FAR)


def assert_same(far: Any, near: Any) -> None:
    """Assert equality to a millionth, except for rounding errors: neighbouring doubles are 1e-9 m apart there."""
    if isinstance(near, dict):
        assert far.keys() == near.keys()
        for key in near:
            if "seconds" not in key:
                assert_same(far[key], near[key])
    elif isinstance(near, list):
        assert len(far) == len(near)
        for one, other in zip(far, near, strict=True):
            assert_same(one, other)
    else:
        assert far == (pytest.approx(near, rel=SAME, abs=1e-8) if isinstance(near, float) else near)


@pytest.mark.parametrize("name", ["q1-short-dense", "q2-short-dense", "q4-three-landmarks"])
def test_a_run_far_away_has_the_same_scores(name: str) -> None:
    truth, recording = simulate(load_scenario(name, ["start=sampled"]), 0)
    with_ids = recording.associated(given(truth.association))
    estimate, optimum = ekf_slam(with_ids), riekf(with_ids)  # any estimate serves as optimum here
    smoothed = replace(optimum, kind="smoothed", nis=None, nis_dof=None)
    near = evaluate(truth, recording, estimate, optimum, smoothed)
    moved = far_run(truth, recording)
    far = evaluate(*moved, far_estimate(estimate), far_estimate(optimum), far_estimate(smoothed))
    assert_same(far.to_json(), near.to_json())
    np.testing.assert_allclose(far.nees, near.nees, rtol=SAME, atol=SAME)
    series = step_series(Measured(*moved, far_estimate(estimate))), step_series(Measured(truth, recording, estimate))
    np.testing.assert_allclose(*series, rtol=SAME, atol=1e-8)
