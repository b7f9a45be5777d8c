"""The Octave course's own .m files through examples/octave: accuracy, checks, seeded bugs and errors."""

from __future__ import annotations

import runpy
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import slamgauge
from slamgauge.compare.checks.examination import CHECKS, check_estimator
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.estimate import Estimate, Estimator
from slamgauge.recording import Recording
from tests.reference.external_programs import program

from .conftest import short

pytestmark = pytest.mark.full  # hundreds of starts of Octave

EXAMPLE = Path(__file__).parents[3] / "examples/octave"
GIVEN_NOISE = {  # edits of the example that use the noise of the recording
    "diag([0.1, 0.1, 0.01])": "G * u.cov * G'",
    "heading = mu(3) + u.r1;": "heading = mu(3) + u.r1; G = eye(3); G(1:2, 1:2) = expm(mu(3) * [0, -1; 1, 0]);",
    "0.01 * eye(2 * count)": "blkdiag(z.cov)",
}
Edited = Callable[[dict[str, str]], Estimator]


@pytest.fixture
def edited(tmp_path: Path) -> Edited:
    """Copies the example and replaces texts in its two functions."""
    program("octave", "octave-cli")

    def make(edits: dict[str, str]) -> Estimator:
        folder = tmp_path / "octave"
        shutil.copytree(EXAMPLE, folder)
        names = ("prediction_step.m", "correction_step.m")
        texts = {name: (folder / name).read_text() for name in names}
        for old, new in edits.items():
            assert sum(text.count(old) for text in texts.values()) == 1, old
            texts = {name: text.replace(old, new) for name, text in texts.items()}
        for name, text in texts.items():
            (folder / name).write_text(text)
        return runpy.run_path(str(folder / "octave.py"))["estimate"]

    return make


def course(seed: int, steps: int = 100) -> tuple[slamgauge.Truth, Recording]:
    scenario = slamgauge.load_scenario("freiburg-course", [f"trajectory.duration={steps}"])
    return slamgauge.simulate(scenario, seed)


def run(estimator: Estimator, recording: Recording) -> Estimate:
    return run_estimator("mine", estimator, recording)[0]


def test_the_right_functions_are_as_accurate_as_ekf_under_their_own_noise(edited: Edited):
    """Mean ATE of eight runs within 5 % of ekf's, and sigmas within 5 %."""
    estimator = edited({})
    errors, sigmas = [], []
    for seed in range(8):
        truth, recording = course(seed)
        estimates = [run(estimator, recording), slamgauge.ekf_slam(recording)]
        assert truth.poses is not None
        errors.append([np.sqrt(((e.poses - truth.poses)[:, :2] ** 2).sum(axis=1).mean()) for e in estimates])
        sigmas.append([np.sqrt(np.trace(e.pose_covs[-1, :2, :2])) for e in estimates if e.pose_covs is not None])
    for mine, reference in (np.mean(errors, axis=0), np.mean(sigmas, axis=0)):
        assert 0.95 < mine / reference < 1.05


def test_ids_may_be_any_numbers(edited: Edited):
    estimator, recording = edited({}), course(1, steps=30)[1]
    assert recording.landmark is not None
    plain = run(estimator, recording)
    renamed = run(estimator, replace(recording, landmark=90 - 7 * recording.landmark))
    assert len(plain.landmark_ids) > 5
    np.testing.assert_allclose(renamed.poses, plain.poses, atol=1e-9)
    order = np.argsort(-renamed.landmark_ids)
    np.testing.assert_array_equal(renamed.landmark_ids[order], 90 - 7 * np.sort(plain.landmark_ids))
    np.testing.assert_allclose(renamed.landmarks[order], plain.landmarks[np.argsort(plain.landmark_ids)], atol=1e-9)


@pytest.mark.parametrize(
    ("bug", "check"),
    [
        ({}, ""),
        ({"F(1, 3) = -u.t": "F(1, 3) = u.t"}, "prediction-jacobian"),
        ({"G * u.cov * G'": "u.cov"}, "odometry-noise-frame"),
        ({"G * u.cov * G'": "G * sqrt(abs(u.cov)) * G'"}, "odometry-noise-size"),
        ({"turn = normalize_angle(z(k)": "turn = (z(k)"}, "innovation-wrap"),
    ],
)
def test_each_seeded_bug_fails_its_check_and_no_other(bug: dict[str, str], check: str, edited: Edited):
    estimator = edited(GIVEN_NOISE | bug)
    verdicts = check_estimator("mine", estimator, checks=CHECKS)
    assert [each.name for each in verdicts if each.is_failure] == ([check] if check else [])


@pytest.mark.parametrize(
    ("name", "edits", "message"),
    [
        (
            "q1-short-dense",
            {"S = H * sigma * H'": "S = H * sigma * nothing"},
            r"octave-cli ended with status 1: 'nothing' undefined.*\(correction_step, line 22\)",
        ),
        ("q2-short-dense", {}, "the course's functions need ranges, bearings and ids; give a recording that has them"),
        ("q4-ring", {}, "the course's functions need ranges, bearings and ids; give a recording that has them"),
    ],
)
def test_errors_are_one_line(name: str, edits: dict[str, str], message: str, edited: Edited):
    with pytest.raises(slamgauge.UserError, match=message) as caught:
        run(edited(edits), short(name))
    assert "\n" not in str(caught.value)


def test_recordings_without_observations(edited: Edited):
    recording = course(2, steps=10)[1]
    empty = np.zeros(0, dtype=np.int64)
    blind = replace(
        recording,
        observation_step=empty,
        landmark=empty,
        observation=np.zeros((0, 2)),
        observation_cov=np.zeros((0, 2, 2)),
    )
    expected = slamgauge.dead_reckoning(blind).poses
    np.testing.assert_allclose(run(edited({}), blind).poses, expected, atol=1e-9)
