"""Twins of logs: properties that they keep, their use as scenarios, and the accuracy of their predictions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.datasets.published import read_lost_in_the_woods
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.storage.files import save
from slamgauge.compare.studies.twin import make_twin, write_twin
from slamgauge.ekf import riekf
from slamgauge.graph_baseline import batch
from slamgauge.recording import Recording
from slamgauge.se2 import between
from tests.reference.given import given
from tests.reference.random_recordings import recording_of

pytestmark = pytest.mark.slow

WOODS = Path(__file__).parents[4] / "shared" / "data" / "lost_in_the_woods" / "dataset2.mat"


def log(sensor: str = "range-bearing", steps: int = 40) -> Recording:
    """Return a log with stamps, covariances and a prior that no scenario of segments has."""
    recording = recording_of(sensor, 4, steps=steps)
    stamps = 3.0 + np.cumsum(np.random.default_rng(1).uniform(0.05, 0.4, steps + 1))
    prior = recording.prior_cov + np.array([[0, 1e-4, 0], [1e-4, 0, 0], [0, 0, 0]])
    return replace(recording, stamps=stamps, prior_cov=prior)


@pytest.mark.parametrize("sensor", ["range-bearing", "position", "bearing"])
def test_a_twin_has_the_logs_stamps_sightings_and_noise_on_the_path_of_its_optimum(sensor: str, tmp_path: Path) -> None:
    recording = log(sensor)
    twin = make_twin(recording)
    write_twin(tmp_path, twin, "a log")
    truth, simulated = simulate(load_scenario(tmp_path / "twin.toml", ["start=mean"]), 0)
    known = twin.recording
    np.testing.assert_array_equal(simulated.stamps, recording.stamps)
    np.testing.assert_allclose(simulated.odometry_cov, recording.odometry_cov, rtol=1e-12)
    np.testing.assert_allclose(simulated.prior_cov, recording.prior_cov, rtol=1e-12)
    np.testing.assert_array_equal(simulated.observation_step, known.observation_step)
    np.testing.assert_allclose(simulated.observation_cov, known.observation_cov, rtol=1e-12)
    optimum, order = batch(recording), np.argsort(twin.optimum.landmark_ids)
    np.testing.assert_allclose(given(truth.poses), optimum.poses, atol=1e-9)
    np.testing.assert_array_equal(optimum.landmark_ids[order][given(truth.association)], known.landmark)
    np.testing.assert_allclose(given(truth.landmarks), optimum.landmarks[order], atol=1e-12)


def test_the_noise_of_a_twin_has_the_covariance_of_each_step(tmp_path: Path) -> None:
    """Whitened by the log's covariances it has variance 1; false-alarm rate 1e-4, two-sided."""
    recording = log(steps=400)
    write_twin(tmp_path, make_twin(recording), "a log")
    truth, simulated = simulate(load_scenario(tmp_path / "twin.toml"), 5)
    path = given(truth.poses)
    noise = simulated.odometry - between(path[:-1], path[1:])
    white = np.linalg.solve(np.linalg.cholesky(recording.odometry_cov), noise[:, :, None])
    assert abs(np.mean(white**2) - 1.0) < 3.9 * np.sqrt(2 / white.size)


def test_equal_covariances_become_a_key_that_can_be_swept(tmp_path: Path) -> None:
    recording = log()
    alike = replace(recording, observation_cov=np.tile(np.diag([0.04, 0.01]), (len(recording.observation), 1, 1)))
    write_twin(tmp_path, make_twin(alike), "a log")
    better = load_scenario(tmp_path / "twin.toml", ["sensor.sigma_range=0.01"])
    np.testing.assert_allclose(better.sensor.sigmas, [0.01, 0.1])


def test_commands_accept_a_twin_as_a_scenario(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A log without ids is associated first."""
    recording = simulate(load_scenario("q2-short-dense", ["trajectory.duration=20"]), 0)[1]
    save(tmp_path / "recording.npz", recording)
    assert main(["twin", str(tmp_path / "recording.npz"), "--out", str(tmp_path / "twin")]) == 0
    printed = capsys.readouterr().err
    assert "no ids: associated by riekf with jcbb, which may be wrong" in printed
    assert "observations: written to" in printed
    toml = str(tmp_path / "twin" / "twin.toml")
    assert load_scenario(toml).association.method == "jcbb"
    assert main(["run", toml, "--estimators", "ekf", "--out", str(tmp_path / "run")]) == 0
    assert main(["twin", str(tmp_path / "none.npz"), "--out", str(tmp_path / "twin")]) == 2


@pytest.mark.full  # a study of a real recording
@pytest.mark.skipif(not WOODS.exists(), reason=f"{WOODS.name} is not there")
def test_the_twin_of_lost_in_the_woods_predicts_its_error(tmp_path: Path) -> None:
    """The position RMSE of the right-invariant filter, mean of thirty runs, within a quarter of the real one."""
    recording, truth, *_ = read_lost_in_the_woods(WOODS)
    write_twin(tmp_path, make_twin(recording), "woods")
    scenario = load_scenario(tmp_path / "twin.toml")
    known = ~np.isnan(given(given(truth).poses)[:, 0])
    actual = np.sqrt(((riekf(recording).poses - given(given(truth).poses))[known, :2] ** 2).sum(axis=1).mean())
    predicted = []
    for seed in range(30):
        made, simulated = simulate(scenario, seed)
        errors = riekf(simulated).poses[:, :2] - given(made.poses)[:, :2]
        predicted.append(np.sqrt((errors**2).sum(axis=1).mean()))
    assert 0.75 < np.mean(predicted) / actual < 1.25
