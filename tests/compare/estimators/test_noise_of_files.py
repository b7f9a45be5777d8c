"""Noise in files of classes and of the Octave course: replaced by the recording's or kept, and announced."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.estimators.adapters import adapted
from slamgauge.compare.estimators.forms.form import remarks_of
from slamgauge.compare.estimators.forms.inner_noise import with_noise
from slamgauge.compare.estimators.requests import ask, with_noise_and_form
from slamgauge.compare.estimators.user_code import Noise, address
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.ekf import ekf_slam
from slamgauge.estimate import Estimate
from tests.reference.class_files import GROWING, NTNU
from tests.reference.course_files import STYLES

from .conftest import short

pytestmark = pytest.mark.slow

COURSE = STYLES["dicts from 1"].source
INIT, NOISE_OF_SELF = "def __init__(self, x0, P0, Q, R):", "        self.Q, self.R = Q, R\n"
WITH_GLOBALS = (
    GROWING.replace(
        "class EkfSlam:", "PROCESS_NOISE = np.diag([0.5, 0.1])\nR = np.diag([0.2, 0.3])\n\n\nclass EkfSlam:"
    )
    .replace(INIT, "def __init__(self, x0, P0):")
    .replace(NOISE_OF_SELF, "")
    .replace("self.Q", "PROCESS_NOISE")
    .replace("self.R", "R")
)
WITH_SCALARS = GROWING.replace(INIT, "def __init__(self, x0, P0, Q, sigma_range=0.3):").replace(
    NOISE_OF_SELF, "        self.Q, self.sigma_range, self.gate = Q, sigma_range, 9.0\n"
)
WITH_SCALARS = WITH_SCALARS.replace("self.R", "np.diag([self.sigma_range**2, 0.01])")
IN_WORLD = (
    GROWING.replace("G = np.zeros((n, 2))", "G = np.zeros((n, 3))")
    .replace("G[:3] = [[dt * np.cos(th), 0], [dt * np.sin(th), 0], [0, dt]]", "G[:3] = np.eye(3)")
    .replace("class EkfSlam:", "class EkfSlam:\n    Q = np.diag([0.1, 0.1, 0.01])\n")
    .replace(INIT, "def __init__(self, x0, P0, R):")
    .replace("self.Q, self.R = Q, R", "self.R = R")
)


def run(folder: Path, source: str, name: str, noise: Noise = "recording") -> tuple[Estimate, list[str]]:
    """Run a file on a few seconds of q1-short-dense; return its estimate and the remarks."""
    (folder / "mine.py").write_text(source)
    estimator, _ = adapted(address(f"{folder / 'mine.py'}:{name}")._replace(noise=noise))
    recording = short()
    return estimator(recording), remarks_of(estimator, recording)


def differs(one: Estimate, other: Estimate) -> bool:
    """Return whether a variance of a pose differs by more than 5 %."""
    variances = [np.diagonal(np.asarray(each.pose_covs), axis1=1, axis2=2) for each in (one, other)]
    return not np.allclose(*variances, rtol=0.05, atol=0.0)


def test_noise_inside_functions_of_the_course_is_replaced_or_kept(tmp_path: Path):
    reference = ekf_slam(short())
    estimate, remarks = run(tmp_path, COURSE, "prediction_step")
    assert not differs(estimate, reference)
    assert remarks[1:] == [
        "motion noise of the file, diag(0.1, 0.1, 0.01), is replaced by the recording's, diag(0.0009, 0, 2.74e-05)",
        "observation noise of the file, diag(0.01, 0.01), is replaced by the recording's, diag(0.01, 0.00762)",
    ]
    kept, remarks = run(tmp_path, COURSE, "prediction_step", "file")
    assert differs(kept, reference)
    assert [each.partition(" noise of the file, ")[0] for each in remarks[1:]] == [
        "assumes motion",
        "assumes observation",
    ]


@pytest.mark.parametrize(
    ("right", "other"),
    [
        ("sigma = G @ sigma @ G.T + R", "sigma = R + np.dot(np.dot(G, sigma), np.transpose(G.T).T)"),
        ("sigma = G @ sigma @ G.T + R", "sigma[:3, :3] = G[:3, :3] @ sigma[:3, :3] @ G[:3, :3].T + R[:3, :3]\n"
         "    sigma[:3, 3:] = G[:3, :3] @ sigma[:3, 3:]\n    sigma[3:, :3] = sigma[:3, 3:].T"),
        ("Q = 0.01 * np.eye(2 * m)", "Q = np.eye(2 * m)\n    Q = Q * 0.01"),
    ],
)  # fmt: skip
def test_other_spellings_of_the_sum_are_found(tmp_path: Path, right: str, other: str):
    assert COURSE.count(right) == 1
    estimate, _ = run(tmp_path, COURSE.replace(right, other), "prediction_step")
    assert np.allclose(estimate.poses, run(tmp_path, COURSE, "prediction_step")[0].poses, atol=1e-9)


@pytest.mark.parametrize(
    "other",
    [
        "sigma = G @ sigma @ G.T\n    sigma[:3, :3] = sigma[:3, :3] + R[:3, :3]",
        "sigma = G @ sigma @ G.T + R / 2\n    sigma = np.eye(len(mu)) @ sigma @ np.eye(len(mu)).T + R / 2",
    ],
)
def test_without_exactly_one_sum_the_noise_of_the_file_counts(tmp_path: Path, other: str):
    source = COURSE.replace("sigma = G @ sigma @ G.T + R", other)
    assert source != COURSE
    estimate, remarks = run(tmp_path, source, "prediction_step")
    assert remarks[1].startswith("its own noise counts: its functions do not have the form G @ sigma @ G.T + R")
    assert np.allclose(estimate.poses, run(tmp_path, COURSE, "prediction_step", "file")[0].poses, atol=1e-9)


def test_an_error_in_a_function_with_replaced_noise_names_its_line(tmp_path: Path):
    first = "    R = np.zeros(sigma.shape)\n"
    source = COURSE.replace(first, f"    if len(mu) > 11: 1 / 0\n{first}")  # the tiny recording has four landmarks
    with pytest.raises(ZeroDivisionError) as caught:
        run(tmp_path, source, "prediction_step")
    assert caught.traceback[-1].lineno + 1 == source[: source.index("1 / 0")].count("\n") + 1
    assert Path(str(caught.traceback[-1].path)).name == "mine.py"


def test_functions_without_source_keep_their_noise():
    names: dict[str, object] = {}
    exec("def f(mu, sigma, u): return mu, u @ sigma @ u.T + 1.0", names)
    assert with_noise(names["f"], "sigma", lambda own: own) is None


@pytest.mark.parametrize("noise", ["recording", "file"])
def test_noise_in_globals_of_a_class(tmp_path: Path, noise: Noise):
    estimate, remarks = run(tmp_path, WITH_GLOBALS, "EkfSlam", noise)
    assert differs(estimate, ekf_slam(short())) == (noise == "file")
    end = ", is replaced by the recording's, " if noise == "recording" else ", where the recording has "
    assert f"motion noise PROCESS_NOISE of the file, diag(0.5, 0.1){end}diag(0.09, 0.00274)" in remarks[1]
    assert f"observation noise R of the file, diag(0.2, 0.3){end}diag(0.01, 0.00762)" in remarks[2]


def test_scalar_noise_of_a_class_is_kept_and_announced(tmp_path: Path):
    _, remarks = run(tmp_path, WITH_SCALARS, "EkfSlam")
    assert remarks[1:] == [
        "its own noise, sigma_range = 0.3, is kept; the recording has motion noise diag(0.09, 0.00274) "
        "and observation noise diag(0.01, 0.00762)"
    ]


def test_noise_of_a_class_in_the_world_frame(tmp_path: Path):
    (tmp_path / "mine.py").write_text(IN_WORLD)
    estimator, _ = adapted(address(f"{tmp_path / 'mine.py'}:EkfSlam"))
    truth, recording = simulate(load_scenario("q1-short-dense"), 1)
    assert truth.poses is not None
    errors = [
        np.sqrt(((estimate.poses - truth.poses)[:, :2] ** 2).sum(axis=1).mean())
        for estimate in (estimator(recording), ekf_slam(recording))
    ]
    assert 0.95 < errors[0] / errors[1] < 1.05
    assert "motion noise Q of the file, diag(0.1, 0.1, 0.01), is replaced" in " ".join(remarks_of(estimator, recording))


def test_a_class_with_r_of_the_motion_and_a_start_of_none(tmp_path: Path):
    source = IN_WORLD.replace("self.R", "OTHER").replace("self.Q", "self.R").replace("OTHER", "self.Q")
    source = source.replace("    Q = np.diag([0.1, 0.1, 0.01])", "    Q, R = np.eye(2), np.diag([0.1, 0.1, 0.01])")
    source = source.replace("(self, x0, P0, R)", "(self)").replace("        self.Q = R\n", "")
    for name in ("mu", "Sigma"):
        source = re.sub(rf"        self.{name} = np.array.*", f"        self.{name} = None", source, count=1)
    estimate, remarks = run(tmp_path, source, "EkfSlam")
    assert np.allclose(estimate.poses, run(tmp_path, IN_WORLD, "EkfSlam")[0].poses)
    assert "motion noise R of the file, diag(0.1, 0.1, 0.01), is replaced" in remarks[1]
    assert "observation noise Q of the file, diag(1, 1), is replaced" in remarks[2]


def test_own_noise_of_the_class_of_ntnu(tmp_path: Path):
    fields = """    do_asso: bool = True
    Q: np.ndarray = field(default_factory=lambda: np.diag([0.1, 0.1, 0.01]))
    R: np.ndarray = field(default_factory=lambda: np.diag([0.1, 0.1]))
"""
    source = NTNU.replace("    Q: np.ndarray\n    R: np.ndarray\n    do_asso: bool\n", fields)
    (right, _), (own, remarks) = (run(tmp_path, source, "EKFSLAM", noise) for noise in ("recording", "file"))
    assert np.array_equal(right.poses, run(tmp_path, NTNU, "EKFSLAM")[0].poses)
    assert differs(own, right)
    assert [each.partition(" of the file")[0] for each in remarks] == [
        "assumes motion noise Q",
        "assumes observation noise R",
    ]


def test_both_noises_are_two_rows_for_each_form(tmp_path: Path):
    (tmp_path / "mine.py").write_text(WITH_GLOBALS)
    asked = with_noise_and_form(ask([f"mine={tmp_path / 'mine.py'}:EkfSlam"]), "both")
    assert [each.label for each in asked] == ["mine", "mine (own noise)"]
    estimates = [adapted(each.where)[0](short()) for each in asked if each.where is not None]
    assert differs(*estimates)
