"""Online classes with the usual names and NTNU's class: right files agree with `ekf`, and bugs fail their checks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import slamgauge
from slamgauge.compare.checks.examination import CHECKS, check_estimator
from slamgauge.compare.estimators.forms.form import remarks_of
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.ekf import ekf_slam
from slamgauge.estimate import Estimate, Estimator
from slamgauge.truth import Truth
from tests.reference.class_files import GROWING, NTNU, WITH_ROOM

from .conftest import Own, short

INIT = "def __init__(self, x0, P0, Q, R):"
PREDICT, UPDATE = "def predict(self, v, w, dt):", "def update(self, z, landmark_id):"
ONE = "\n\n    def one(self, z, landmark_id):"
WITH_LATERAL = {
    "        th = self.mu[2]": "        th, dt = self.mu[2], 1.0",
    "G = np.zeros((n, 2))": "G = np.zeros((n, 3))",
    "G[:3] = [[dt * np.cos(th), 0], [dt * np.sin(th), 0], [0, dt]]": "G[:3] = [[np.cos(th), -np.sin(th), 0], "
    "[np.sin(th), np.cos(th), 0], [0, 0, 1]]",
}
STYLES: dict[str, tuple[str, dict[str, str]]] = {
    "v, w, dt and once per landmark": ("predict(v, w, dt), update(landmark_id, z) per landmark", {}),
    "u, and dt in the constructor": (
        "u = [v, w], update(landmark_id, r, b) per landmark",
        {
            INIT: "def __init__(self, measurement_noise, initial_state, initial_cov, process_noise, dt=7.0):\n"
            "        Q, R, x0, P0, self.dt = process_noise, measurement_noise, initial_state, initial_cov, dt",
            PREDICT: "def prediction(self, u):\n        v, w, dt = u[0], u[1], self.dt",
            UPDATE: "def correct(self, landmark_id, r, b):\n        z = np.array([r, b])",
        },
    ),
    "start and noise of its own": (
        "measurements = rows [range, bearing, id]",
        {
            INIT: "def __init__(self):\n        x0, P0, Q, R = np.zeros(3), np.eye(3), np.diag([0.1, 0.1]), np.eye(2)",
            PREDICT: "def motion_update(self, control, dt):\n        v, w = control",
            UPDATE: "def measurement_update(self, measurements):\n        for r, b, j in measurements:\n"
            f"            self.one(np.array([r, b]), int(j)){ONE}",
        },
    ),
    "R of the motion (3, 3), Q of observations": (
        "u = [dx, dy, dtheta], update with z (m, 2), ids (m,)",
        {
            **WITH_LATERAL,
            INIT: "def __init__(self, R, Q, mu0, Sigma0):\n        x0, P0, Q, R = mu0, Sigma0, R, Q",
            PREDICT: "def predict(self, u):\n        v, _, w = u",
            UPDATE: "def correct(self, ids, z):\n        for j, each in zip(ids, z):\n"
            f"            self.one(each, j){ONE}",
        },
    ),
    "distance and turn, ids first": (
        "u = [distance, turn], update with z = observations (id, range, bearing)",
        {
            PREDICT: "def predict(self, u):\n        v, w = u\n        dt = 1.0",
            UPDATE: "def update(self, z):\n        for j, r, b in z:\n            "
            f"self.one(np.array([r, b]), int(j)){ONE}",
            "self.mu": "self.state",
            "self.Sigma": "self.covariance",
        },
    ),
    "coordinates of the start": (
        "predict(v, omega, dt), update(id, r, b) per landmark",
        {
            INIT: "def __init__(self, start_x, start_y, start_theta, Q=None, R=None):\n"
            "        x0, P0 = [start_x, start_y, start_theta], np.zeros((3, 3))",
            PREDICT: "def predict(self, v, omega, dt):\n        w = omega",
            UPDATE: "def update(self, r, b, id):\n        landmark_id, z = id, np.array([r, b])",
            "self.mu": "self.x",
            "self.Sigma": "self.P",
        },
    ),
    "increment and its covariance": (
        "increment = [dx, dy, dtheta]",
        {
            **WITH_LATERAL,
            PREDICT: "def predict(self, increment, cov):\n        v, _, w = increment",
            "@ self.Q @": "@ cov @",
        },
    ),
}


def changed(source: str, changes: dict[str, str]) -> str:
    """Replace lines of a file; each must be there."""
    for old, new in changes.items():
        assert old in source, old
        source = source.replace(old, new)
    return source


def ate(estimate: Estimate, truth: Truth) -> float:
    assert truth.poses is not None
    return float(np.sqrt(((estimate.poses - truth.poses)[:, :2] ** 2).sum(axis=1).mean()))


def loaded(folder: Path, source: str, attribute: str) -> Estimator:
    """Load an estimator of a file, as the commands do."""
    (folder / "mine.py").write_text(source)
    return load_estimators([f"mine={folder / 'mine.py'}:{attribute}"])["mine"]


def ratios(mine: Estimator) -> list[float]:
    """Return ATE over that of `ekf` for three seeds of q1-short-dense."""
    runs = [simulate(load_scenario("q1-short-dense"), seed) for seed in (1, 2, 3)]
    return [ate(mine(recording), truth) / ate(ekf_slam(recording), truth) for truth, recording in runs]


@pytest.mark.parametrize("style", STYLES)
def test_right_classes_agree_with_ekf(tmp_path: Path, capsys: pytest.CaptureFixture[str], style: str):
    words, changes = STYLES[style]
    mine = loaded(tmp_path, changed(GROWING, changes), "EkfSlam")
    assert all(0.95 < ratio < 1.05 for ratio in ratios(mine))
    recording = short()
    estimate, reference = mine(recording), ekf_slam(recording)
    assert np.array_equal(estimate.landmark_ids, reference.landmark_ids)
    assert estimate.association is not None
    variances = [np.diagonal(np.asarray(each.pose_covs), axis1=1, axis2=2) for each in (estimate, reference)]
    assert np.allclose(*variances, rtol=0.05, atol=0.0)
    assert "mine: online class EkfSlam: " in capsys.readouterr().err
    remarks = " ".join(remarks_of(mine, recording))
    assert words in remarks
    is_own = style == "start and noise of its own"
    assert (
        "motion noise Q of the file, diag(0.1, 0.1), is replaced by the recording's, diag(0.09, " in remarks
    ) == is_own
    assert ("observation noise R of the file, diag(1, 1), is replaced by the recording's" in remarks) == is_own


def test_a_class_with_room_for_all_landmarks_and_ids_from_1(tmp_path: Path):
    mine = loaded(tmp_path, WITH_ROOM, "EKF_SLAM")
    assert all(0.95 < ratio < 1.05 for ratio in ratios(mine))
    assert "ids from 1" in remarks_of(mine, short())[0]


def test_a_class_that_moves_on_arcs_is_told_its_bias(tmp_path: Path):
    straight = "self.mu[:3] += [v * dt * np.cos(th), v * dt * np.sin(th), w * dt]"
    arc = straight.replace("(th)", "(th + w * dt / 2)")
    recording, text = short(), "it moves on an arc in each step"
    remarks = []
    mean_only = [check for check in CHECKS if check.name == "truth-recovered"]
    for change, passes in ((straight, True), (arc, True), (straight.replace("(th)", "(th + w * dt)"), False)):
        mine = loaded(tmp_path, changed(GROWING, {straight: change}), "EkfSlam")
        mine(recording)
        remarks.append(" ".join(remarks_of(mine, recording)))
        (verdict,) = check_estimator("mine", mine, checks=mean_only)
        assert (verdict.passed, verdict.limit_of_method) == (passes, change == arc)
        assert (text in verdict.blame) == (change == arc)
    assert text not in remarks[0]
    assert text in remarks[1]


@pytest.mark.parametrize("shape", ["assert z.ndim == 1", "z = z[:, :2].ravel()"])
def test_the_class_of_ntnu_associates_by_itself(tmp_path: Path, capsys: pytest.CaptureFixture[str], shape: str):
    source = changed(NTNU, {"        NIS = 1.0\n": f"        NIS = 1.0\n        {shape}\n"})
    assert all(0.75 < ratio < 1.25 for ratio in ratios(loaded(tmp_path, source, "EKFSLAM")))
    assert "mine: class of NTNU's course EKFSLAM: predict(eta, P, z_odo)" in capsys.readouterr().err


def test_the_computing_time_of_the_class_of_ntnu_is_that_of_its_methods(own: Own):
    source = changed(NTNU, {"        NIS = 1.0\n": "        NIS = 1.0\n        import time; time.sleep(0.01)\n"})
    recording = short()
    scans = len(np.unique(recording.observation_step))
    seconds = own(source, recording, "EKFSLAM").seconds
    assert seconds is not None
    assert 0.01 * scans < seconds.sum() < 0.01 * scans + 5.0


def test_the_constructor_names_what_it_lacks(own: Own):
    source = changed(GROWING, {INIT: "def __init__(self, x0, P0, Q, R, wheel_radius, width=1.0):"})
    with pytest.raises(slamgauge.UserError, match="its constructor needs wheel_radius, which no recording has"):
        own(source, short(), "EkfSlam")
    with pytest.raises(slamgauge.UserError, match="update needs landmark_id; give a recording with ids"):
        own(GROWING, short("q2-short-dense"), "EkfSlam")


BUGS = {
    "sign": ("prediction-jacobian", "F[0, 2], F[1, 2] = -v", "F[0, 2], F[1, 2] = v"),
    "wrap": ("innovation-wrap", "        y[1] = wrap(y[1])\n", ""),
    "cross": ("cross-covariance", "[self.Sigma, C.T], [C,", "[self.Sigma, 0 * C.T], [0 * C,"),
    "ntnu sign": ("prediction-jacobian", "F[0, 2] = -u[0]", "F[0, 2] = u[0]"),
    "ntnu wrap": ("innovation-wrap", "                v[1::2] = wrap(v[1::2])\n", ""),
    "ntnu cross": ("cross-covariance", "P @ Gx.T], [Gx @ P,", "0 * P @ Gx.T], [0 * Gx @ P,"),
}


@pytest.mark.parametrize("bug", BUGS)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # bugs may overflow
def test_a_seeded_bug_fails_its_check_and_no_other(tmp_path: Path, bug: str):
    named, old, new = BUGS[bug]
    source, kind = (NTNU, "EKFSLAM") if bug.startswith("ntnu") else (GROWING, "EkfSlam")
    assert failed(loaded(tmp_path, changed(source, {old: new}), kind)) == {named}


@pytest.mark.parametrize(("source", "kind"), [(GROWING, "EkfSlam"), (WITH_ROOM, "EKF_SLAM"), (NTNU, "EKFSLAM")])
def test_right_files_pass_all_checks(tmp_path: Path, source: str, kind: str):
    assert failed(loaded(tmp_path, source, kind)) == set()


def failed(mine: Estimator) -> set[str]:
    return {each.name for each in check_estimator("mine", mine, 0, CHECKS) if each.is_failure}
