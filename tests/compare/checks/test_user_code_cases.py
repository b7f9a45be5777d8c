"""Files that version 0.5 judged wrongly, written again in small, each with its right answer (`../shared/cases`)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.checks.examination import check_estimator
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.errors import UserError
from slamgauge.estimate import Estimator

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[3] / "examples"
LATE = '''
import numpy as np

class EkfSlam:
    """New landmarks have a large covariance, and the first observation corrects them at once."""

    def __init__(self, mu, Sigma):
        self.mu, self.Sigma, self.seen = mu, Sigma, {}

    def predict(self, increment, cov):
        (d, _, turn), t, F = increment, self.mu[2], np.eye(len(self.mu))
        F[0, 2], F[1, 2] = -d * np.sin(t), d * np.cos(t)
        V = np.array([[np.cos(t), -np.sin(t), 0], [np.sin(t), np.cos(t), 0], [0, 0, 1]])
        self.mu = self.mu.copy()
        self.mu[:3] += d * np.cos(t), d * np.sin(t), turn
        self.Sigma = F @ self.Sigma @ F.T
        self.Sigma[:3, :3] += V @ cov @ V.T

    def update(self, ids, values, covs):
        for name, z, R in zip(ids, values, covs):
            if name not in self.seen:
                self.seen[name] = k = len(self.mu)
                a = self.mu[2] + z[1]
                self.mu = np.append(self.mu, self.mu[:2] + z[0] * np.array([np.cos(a), np.sin(a)]))
                self.Sigma = np.block([[self.Sigma, np.zeros((k, 2))], [np.zeros((2, k)), 1000 * np.eye(2)]])
            k, H = self.seen[name], np.zeros((2, len(self.mu)))
            dx, dy = self.mu[k : k + 2] - self.mu[:2]
            r = np.hypot(dx, dy)
            H[:, :3] = [-dx / r, -dy / r, 0], [dy / r**2, -dx / r**2, -1]
            H[:, k : k + 2] = -H[:, :2]
            K = self.Sigma @ H.T @ np.linalg.inv(H @ self.Sigma @ H.T + R)
            y = z - [r, np.arctan2(dy, dx) - self.mu[2]]
            y[1] = (y[1] + np.pi) % (2 * np.pi) - np.pi
            self.mu, self.Sigma = self.mu + K @ y, self.Sigma - K @ H @ self.Sigma

class Wrapper(EkfSlam):
    def __init__(self, prior_mean, prior_cov):
        super().__init__(prior_mean, prior_cov)

    pose = property(lambda self: self.mu[:3])
    pose_cov = property(lambda self: self.Sigma[:3, :3])
    landmark_ids = property(lambda self: list(self.seen))
    landmarks = property(lambda self: self.mu[3:].reshape(-1, 2))
'''
OWN_NOISE = (("V @ cov @ V.T", "V @ np.diag([1e-4, 0, 1e-5]) @ V.T"),)
STEP = (EXAMPLES / "student_ekf.py").read_text(encoding="utf-8")
OWN_STEP = STEP.replace("B @ Q @ B.T", "B @ NOISE_U @ B.T") + "\nNOISE_U = np.diag([0.18, 0.005])\n"


def written(folder: Path, source: str, *changes: tuple[str, str]) -> Path:
    for old, new in changes:
        assert old in source
        source = source.replace(old, new)
    (folder / "mine.py").write_text(source)
    return folder / "mine.py"


def estimator(file: Path) -> Estimator:
    name = "Wrapper" if "Wrapper" in file.read_text() else "ekf_slam" if "ekf_slam" in file.read_text() else "estimate"
    return load_estimators([f"mine={file}:{name}"])["mine"]


@pytest.mark.parametrize(
    ("source", "changes", "failed"),
    [
        (OWN_STEP, (), []),
        (LATE, OWN_NOISE, []),
        (LATE, (), []),
        (LATE, (("np.arctan2(dy, dx)", "np.arctan2(dx, dy)"),), ["update-bearing"]),
        (LATE, (("z - [r,", "z - [2 * r,"),), ["update-range"]),
        (LATE, (("a = self.mu[2] + z[1]", "a = z[1]"),), ["truth-recovered"]),
    ],
    ids=["own noise, step", "own noise", "zero sigma", "wrong bearing", "wrong range", "wrong place of a landmark"],
)
def test_a_right_filter_fails_no_check_and_a_wrong_prediction_its_own(
    tmp_path: Path, source: str, changes: tuple[tuple[str, str], ...], failed: list[str]
):
    """Own noise, and covariances that are symmetric except for rounding, are not mistakes."""
    file = written(tmp_path, source, *changes)
    for seed in range(3):
        verdicts = check_estimator("mine", estimator(file), seed)
        assert [each.name for each in verdicts if each.is_failure] == failed
        own = {each.name for each in verdicts if "ignores the odometry noise" in each.blame}
        assert ("odometry-noise-size" in own) == (source == OWN_STEP or changes == OWN_NOISE)


def test_what_a_file_configures_by_calls_when_it_is_loaded_counts(tmp_path: Path):
    source = """
import numpy as np
from slamgauge import Estimate
NOISE, GAINS = np.zeros((2, 2)), []
def configure(speed):
    NOISE[:] = speed**2
configure(0.3)
for gain in range(3):
    GAINS.append(gain)
def estimate(recording):
    return Estimate("filtered", np.tile([NOISE[0, 0], len(GAINS), 0.0], (recording.steps + 1, 1)))
"""
    recording = simulate("q1-short-dense", 0)[1]
    assert np.allclose(estimator(written(tmp_path, source))(recording).poses, [0.09, 3.0, 0.0])


TWO = "def predict(X, P, control, control_cov, k): ...\ndef update(X, P, measure, measure_cov, k): ..."
POSITIONS = """
class EKF:
    def __init__(self, Q, R): self.mu = self.Sigma = 0
    def predict(self, v, w, dt): ...
    def update(self, z, landmark_id): ...
"""
PARTS = "def motion_model(x, u): ...\ndef ekf_predict(x, P, u, Q, dt): ...\ndef ekf_update(x, P, z, R): ..."
STATES = "it lacks estimate(recording), ekf_slam(xEst, PEst, u, y), or a class with"


@pytest.mark.parametrize(
    ("source", "has", "lacks", "calls"),
    [
        (TWO, "the file has predict(X, P, control,", STATES, "self.x, self.P = update(X, P, measure, measure_cov, k)"),
        (POSITIONS, "class EKF(Q, R) has predict(v, w, dt), update(z", "it lacks predict(", "self.filter.mu[:3]"),
        (PARTS, "the file has motion_model(x, u), ekf_pred", STATES, "self.x, self.P = ekf_predict(x, P, u, Q, dt)"),
        ("x = 1", "the file has no function and no class", STATES, "self.x, self.P = predict(...)"),
        ("class Node:\n    def scan_callback(self, msg): ...", "the file has no function", STATES, "update(...)"),
    ],
)
def test_another_form_is_refused_with_what_it_has_and_the_wrapper(
    tmp_path: Path, source: str, has: str, lacks: str, calls: str
):
    with pytest.raises(UserError) as caught:
        load_estimators([f"mine={written(tmp_path, source)}"])
    first, second, remedy, *wrapper = str(caught.value).splitlines()
    assert has in first and lacks in second
    assert remedy.startswith("copy this wrapper into another file")
    assert "class Wrapper:" in "\n".join(wrapper) and calls in "\n".join(wrapper)
