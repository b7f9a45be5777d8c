"""Memory of the solution of the linear problem, and landmarks that it cannot determine."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from slamgauge.errors import UserError
from slamgauge.graph_baseline import batch, causal, gtsam_batch
from slamgauge.graph_baseline.problem.objective import Objective
from slamgauge.graph_baseline.problem.preparation import prepare
from slamgauge.graph_baseline.solver import smoother
from slamgauge.graph_baseline.solver.smoother import solve
from tests.reference.random_recordings import random_recording, recording_of

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("sparse", [False, True])
def test_a_single_bearing_does_not_determine_a_landmark(sparse: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(smoother, "is_sparse", lambda *_: sparse)
    problem = prepare(recording_of("bearing", 0, steps=20))
    problem = problem.only(np.isin(np.arange(len(problem.slot)), problem.first_row))
    objective = Objective(problem)
    point = objective.at(problem.dead_reckoning, np.random.default_rng(0).normal(size=(len(problem.landmark_ids), 2)))
    with pytest.raises(np.linalg.LinAlgError):
        solve(point.model, objective.scans, len(point.landmarks))


@pytest.mark.parametrize(("steps", "landmarks"), [(40, 400), (400, 60)])
def test_the_estimated_memory_is_an_upper_bound(steps: int, landmarks: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is at most four times too large."""
    problem = prepare(random_recording(0, sensor="position", steps=steps, landmarks=landmarks)[1])
    objective = Objective(problem)
    point = objective.at(problem.dead_reckoning, np.random.default_rng(0).normal(size=(len(problem.landmark_ids), 2)))
    estimates: list[float] = []
    monkeypatch.setattr(smoother, "require_memory", lambda needed, *_: estimates.append(needed))
    smoother.require_memory_for(problem, "batch")
    for _ in range(2):  # the first also compiles kernels
        tracemalloc.start()
        solve(point.model, objective.scans, len(point.landmarks))
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert 0.25 * estimates[0] < peak < estimates[0]


def test_a_map_too_large_for_dense_matrices_is_refused_with_the_estimator_that_serves_instead(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 1e4)
    recording = random_recording(0, steps=20)[1]
    for estimator in (batch, causal):
        with pytest.raises(UserError, match=r"landmarks in 21 poses needs 0\.0 GB .*; use gtsam-batch or isam2"):
            estimator(recording)
    assert len(gtsam_batch(recording).poses) == 21
