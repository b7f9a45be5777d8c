"""Translations of the Octave course in another scenario, whose noise is set: as accurate as `ekf`, in each style."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.compare.estimators.adapters import adapted
from slamgauge.compare.estimators.user_code import Noise, address
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.ekf import ekf_slam
from slamgauge.recording import Recording
from tests.reference.course_files import STYLES

pytestmark = pytest.mark.slow


@cache
def runs() -> list[tuple[Float, Recording, float]]:
    """Return true poses, recording and error of ekf [m] for seeds 0 to 2."""
    simulated = [simulate(load_scenario("q1-short-dense"), seed) for seed in range(3)]
    pairs = [(np.asarray(truth.poses, np.float64), recording) for truth, recording in simulated]
    return [(poses, recording, ate(ekf_slam(recording).poses, poses)) for poses, recording in pairs]


def ate(poses: Float, truth: Float) -> float:
    return float(np.sqrt(np.mean(np.sum((poses[:, :2] - truth[:, :2]) ** 2, axis=1))))


def ratios(source: str, name: str, folder: Path, noise: Noise = "recording") -> Float:
    """Return the errors of a file over those of ekf (3,)."""
    file = folder / "mine.py"
    file.write_text(source)
    estimator, _ = adapted(address(f"{file}:{name}")._replace(noise=noise))
    return np.array([ate(estimator(recording).poses, truth) / reference for truth, recording, reference in runs()])


@pytest.mark.full  # the styles are the same filter
@pytest.mark.parametrize("name", STYLES)
def test_each_style_has_the_error_of_ekf_in_a_scenario_with_other_noise(name: str, tmp_path: Path):
    """The largest difference is 0.4 %; the bound is that of issue 39."""
    found = ratios(STYLES[name].source, STYLES[name].predict, tmp_path)
    assert np.all(np.abs(found - 1.0) < 0.05), found


def test_with_its_own_noise_a_file_has_the_error_of_ekf_with_that_noise(tmp_path: Path):
    """The noise of the file is ten times too large here, and multiplies the errors of both by 1.3 to 4.4.

    The differences are 4, 1 and 11 %; the bound is that of issue 39 for files with their own noise.
    """
    found = ratios(STYLES["dicts from 1"].source, "prediction_step", tmp_path, "file")
    odometry, observation = np.diag([0.1, 0.1, 0.01]), 0.01 * np.eye(2)
    same = [
        ate(ekf_slam(replace(recording, odometry_cov=odometry, observation_cov=observation)).poses, truth) / reference
        for truth, recording, reference in runs()
    ]
    assert float(np.mean(found)) > 1.5
    assert np.all(np.abs(found / same - 1.0) < 0.25), (found, same)
