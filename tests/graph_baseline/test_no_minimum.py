"""What optima do where there is no minimum, or only later: misread ids, a landmark at the sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from random_recordings import random_recording

from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, isam2
from slamgauge.graph_baseline.growing import GrowingOptimum
from slamgauge.recording import Recording


def misread(recording: Recording, until: int, share: float) -> Recording:
    """Some ids of the first steps are another landmark's."""
    rng = np.random.default_rng(0)
    assert recording.landmark is not None
    ids = recording.landmark.copy()
    wrong = (recording.observation_step < until) & (rng.random(len(ids)) < share)
    ids[wrong] = rng.choice(np.unique(ids), wrong.sum())
    return replace(recording, landmark=ids)


def test_steps_without_a_minimum_are_flagged_though_the_last_has_one() -> None:
    recording = misread(random_recording(0, steps=40, noise=0.1)[1], 20, 1.0)
    growing = GrowingOptimum(recording)
    for _ in range(recording.steps + 1):
        growing.add_step()
    assert growing.unsettled_steps
    assert isam2(recording).optimum_check == np.inf


def test_a_minimum_is_not_sought_at_every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    sought: list[int] = []

    def search_fails(growing: GrowingOptimum) -> None:
        sought.append(len(growing.landmark_ids))

    def does_not_converge(_: GrowingOptimum) -> bool:
        return False

    monkeypatch.setattr(GrowingOptimum, "_searched", search_fails)
    monkeypatch.setattr(GrowingOptimum, "_converge", does_not_converge)
    growing = GrowingOptimum(random_recording(0, steps=300)[1])
    for _ in range(301):
        growing.add_step()
    assert growing.unsettled_steps > 290
    assert len(sought) < 30


@pytest.mark.parametrize("optimum", [batch, isam2])
def test_a_range_of_zero_at_first_sight_is_a_mistake_in_one_line_or_none(optimum: Callable[..., Estimate]) -> None:
    recording = random_recording(2, steps=30)[1]
    observation = recording.observation.copy()
    observation[0, 0] = 0.0
    try:
        assert isinstance(optimum(replace(recording, observation=observation)), Estimate)
    except UserError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("optimum", [batch, isam2])
def test_a_position_of_zero_is_as_good_as_any(optimum: Callable[..., Estimate]) -> None:
    recording = random_recording(2, steps=30, sensor="position")[1]
    observation = recording.observation.copy()
    observation[0] = 0.0
    changed = replace(recording, observation=observation)
    near = replace(recording, observation=np.where(observation == 0.0, 1e-7, observation))
    np.testing.assert_allclose(optimum(changed).poses, optimum(near).poses, atol=1e-4)
