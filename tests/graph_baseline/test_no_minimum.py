"""Optima of recordings whose steps have no minimum or change it, and of a landmark at the sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import UndeterminedError, batch, causal
from slamgauge.graph_baseline.problem.preparation import Problem, prepare
from slamgauge.graph_baseline.solver import incremental
from slamgauge.graph_baseline.solver.chord_descent import ChordDescent
from slamgauge.graph_baseline.solver.incremental import Change, IncrementalOptimum
from tests.reference.random_recordings import random_recording

pytestmark = pytest.mark.slow


def does_not_converge(_: ChordDescent) -> bool:
    return False


def test_optimum_check_is_infinite_if_some_steps_have_no_minimum(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = random_recording(3, steps=30)[1]
    failing = range(10, 13)
    add_step = IncrementalOptimum.add_step
    converged: list[bool] = []

    def search_fails(_: IncrementalOptimum) -> None:
        pass

    def failing_step(incremental: IncrementalOptimum) -> None:
        with monkeypatch.context() as patch:
            if len(converged) in failing:
                patch.setattr(ChordDescent, "converge", does_not_converge)
                patch.setattr(IncrementalOptimum, "_search", search_fails)
            add_step(incremental)
        converged.append(incremental.converged)

    monkeypatch.setattr(IncrementalOptimum, "add_step", failing_step)
    check = causal(recording).optimum_check
    assert [k for k in range(31) if not converged[k]] == [*failing]
    assert check == np.inf


def test_failed_searches_for_a_minimum_are_not_repeated_at_every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    searches: list[int] = []

    def search_fails(problem: Problem, *_: object) -> None:
        searches.append(problem.steps)
        raise UndeterminedError("no minimum")

    monkeypatch.setattr(incremental, "placed_minimum", search_fails)
    monkeypatch.setattr(ChordDescent, "converge", does_not_converge)
    optimum = IncrementalOptimum(random_recording(0, steps=300)[1])
    for _ in range(301):
        optimum.add_step()
    assert optimum.unconverged_steps > 290
    assert len(searches) < 30


@pytest.mark.parametrize("optimum", [batch, causal])
def test_a_first_range_of_zero_gives_an_estimate_or_a_one_line_error(optimum: Callable[..., Estimate]) -> None:
    recording = random_recording(2, steps=30)[1]
    observation = recording.observation.copy()
    observation[0, 0] = 0.0
    try:
        assert isinstance(optimum(replace(recording, observation=observation)), Estimate)
    except UserError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("optimum", [batch, causal])
def test_an_observed_position_of_zero_is_valid(optimum: Callable[..., Estimate]) -> None:
    recording = random_recording(2, steps=30, sensor="position")[1]
    observation = recording.observation.copy()
    observation[0] = 0.0
    changed = replace(recording, observation=observation)
    near = replace(recording, observation=np.where(observation == 0.0, 1e-7, observation))
    np.testing.assert_allclose(optimum(changed).poses, optimum(near).poses, atol=1e-4)


def test_an_unlikely_increase_of_the_cost_starts_a_search_for_a_lower_minimum(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = random_recording(3, steps=30)[1]
    optimum_so_far = IncrementalOptimum(recording)
    for _ in range(recording.steps):
        optimum_so_far.add_step()

    def converge_with_high_cost(descent: ChordDescent) -> bool:
        descent.chi_square = 1e6
        return True

    monkeypatch.setattr(ChordDescent, "converge", converge_with_high_cost)
    optimum_so_far.add_step()
    optimum = batch(recording)
    assert optimum.pose_covs is not None
    sigma = np.sqrt(np.diag(optimum.pose_covs[-1]))
    assert np.abs(optimum_so_far.newest_pose() - optimum.poses[-1]).max() < 1e-6 * sigma.min()


@pytest.mark.parametrize("error", [0.0, 3.0])
def test_optimum_check_includes_the_pose_before_a_switch_of_minimum(
    monkeypatch: pytest.MonkeyPatch, error: float
) -> None:
    """The pose of step 20 has an error [sigmas]; at step 21 the estimator switches to the right minimum."""
    recording = random_recording(3, steps=30)[1]
    ids = np.unique(prepare(recording).landmark)
    add_step, newest_pose = IncrementalOptimum.add_step, IncrementalOptimum.newest_pose

    def switching_step(incremental: IncrementalOptimum) -> None:
        add_step(incremental)
        path = incremental.path_and_map()[0]
        if len(path) == 22:
            incremental.changes.append(Change(path, ids))

    def wrong_pose(incremental: IncrementalOptimum) -> Float:
        is_wrong = len(incremental.path_and_map()[0]) == 21
        return newest_pose(incremental) + is_wrong * error * np.sqrt(np.diag(incremental.newest_cov()))

    monkeypatch.setattr(IncrementalOptimum, "add_step", switching_step)
    monkeypatch.setattr(IncrementalOptimum, "newest_pose", wrong_pose)
    check = causal(recording).optimum_check
    assert check is not None
    assert (check == pytest.approx(error, abs=0.05)) if error else check < 0.02
