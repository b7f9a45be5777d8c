"""What optima do where there is no minimum, or only later, and with a landmark at the sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal
from slamgauge.graph_baseline.problem.linearisation import linearise
from slamgauge.graph_baseline.problem.preparation import require_known_landmarks
from slamgauge.graph_baseline.solver.chord_descent import ChordDescent
from slamgauge.graph_baseline.solver.incremental import IncrementalOptimum, MinimumSwitch
from slamgauge.graph_baseline.solver.reduced_scans import Damping
from slamgauge.graph_baseline.solver.smoother import damped_step
from slamgauge.se2 import chain
from tests.reference.random_recordings import random_recording


def does_not_converge(_: ChordDescent) -> bool:
    return False


def test_steps_without_a_minimum_are_flagged_though_the_last_has_one(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = random_recording(3, steps=30)[1]
    lost = range(10, 13)
    add_step = IncrementalOptimum.add_step
    converged: list[bool] = []

    def search_fails(_: IncrementalOptimum) -> None:
        pass

    def noted(growing: IncrementalOptimum) -> None:
        with monkeypatch.context() as patch:
            if len(converged) in lost:
                patch.setattr(ChordDescent, "converge", does_not_converge)
                patch.setattr(IncrementalOptimum, "_search_result", search_fails)
            add_step(growing)
        converged.append(growing.converged)

    monkeypatch.setattr(IncrementalOptimum, "add_step", noted)
    check = causal(recording).optimum_check
    assert [k for k in range(31) if not converged[k]] == [*lost]
    assert check == np.inf


def test_a_minimum_is_not_sought_at_every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    sought: list[int] = []

    def search_fails(growing: IncrementalOptimum) -> None:
        sought.append(len(growing.landmark_ids))

    monkeypatch.setattr(IncrementalOptimum, "_search_result", search_fails)
    monkeypatch.setattr(ChordDescent, "converge", does_not_converge)
    growing = IncrementalOptimum(random_recording(0, steps=300)[1])
    for _ in range(301):
        growing.add_step()
    assert growing.unconverged_steps > 290
    assert len(sought) < 30


@pytest.mark.parametrize("optimum", [batch, causal])
def test_a_range_of_zero_at_first_sight_is_a_mistake_in_one_line_or_none(optimum: Callable[..., Estimate]) -> None:
    recording = random_recording(2, steps=30)[1]
    observation = recording.observation.copy()
    observation[0, 0] = 0.0
    try:
        assert isinstance(optimum(replace(recording, observation=observation)), Estimate)
    except UserError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("optimum", [batch, causal])
def test_a_position_of_zero_is_as_good_as_any(optimum: Callable[..., Estimate]) -> None:
    recording = random_recording(2, steps=30, sensor="position")[1]
    observation = recording.observation.copy()
    observation[0] = 0.0
    changed = replace(recording, observation=observation)
    near = replace(recording, observation=np.where(observation == 0.0, 1e-7, observation))
    np.testing.assert_allclose(optimum(changed).poses, optimum(near).poses, atol=1e-4)


def test_a_damped_step_holds_motions_that_nothing_sees() -> None:
    recording = random_recording(1, steps=20)[1]
    recording = recording.only((recording.observation_step < 5) | (recording.observation_step > 15))
    assert recording.landmark is not None
    ids, slot = np.unique(recording.landmark, return_inverse=True)
    rng = np.random.default_rng(0)
    path = chain(recording.prior_mean, recording.odometry + rng.normal(0.0, 0.05, recording.odometry.shape))
    model = linearise(recording, slot, path, rng.normal(size=(len(ids), 2)))
    strong = damped_step(model, len(ids), Damping(np.full(3, 1e12), 1e12, 1e12))
    assert max(np.abs(each).max() for each in strong) < 1e-6
    free = damped_step(model, len(ids), Damping(np.full(3, 1e12), 1e12, 0.0))
    assert np.abs(free[0]).max() > 1e-3


def test_the_causal_optimum_leaves_a_minimum_whose_cost_leaps(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = random_recording(3, steps=30)[1]
    growing = IncrementalOptimum(recording)
    for _ in range(recording.steps):
        growing.add_step()

    def ends_elsewhere(descent: ChordDescent) -> bool:
        descent.chi_square = 1e6
        return True

    monkeypatch.setattr(ChordDescent, "converge", ends_elsewhere)
    growing.add_step()
    optimum = batch(recording)
    assert optimum.pose_covs is not None
    sigma = np.sqrt(np.diag(optimum.pose_covs[-1]))
    assert np.abs(growing.newest_pose() - optimum.poses[-1]).max() < 1e-6 * sigma.min()


@pytest.mark.parametrize(("wrong", "flagged"), [(0.0, False), (3.0, True)])
def test_a_step_before_a_leap_is_flagged_where_its_pose_was_off(
    monkeypatch: pytest.MonkeyPatch, wrong: float, flagged: bool
) -> None:
    """The pose of step 20 is put off by some sigmas, and a search leads to the right path at step 21."""
    recording = random_recording(3, steps=30)[1]
    ids = np.unique(require_known_landmarks(recording))
    add_step, newest_pose = IncrementalOptimum.add_step, IncrementalOptimum.newest_pose

    def leaping(growing: IncrementalOptimum) -> None:
        add_step(growing)
        path = growing.path_and_map()[0]
        if len(path) == 22:
            growing.switches.append(MinimumSwitch(path, ids))

    def off(growing: IncrementalOptimum) -> Float:
        is_wrong = len(growing.path_and_map()[0]) == 21
        return newest_pose(growing) + is_wrong * wrong * np.sqrt(np.diag(growing.newest_cov()))

    monkeypatch.setattr(IncrementalOptimum, "add_step", leaping)
    monkeypatch.setattr(IncrementalOptimum, "newest_pose", off)
    check = causal(recording).optimum_check
    assert check is not None
    assert (check == pytest.approx(wrong, abs=0.05)) if flagged else check < 0.02
