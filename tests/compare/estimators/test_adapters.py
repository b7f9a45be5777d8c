"""Forms of user filters: each is found by its signature, receives the data of the recording, and reports its map."""

from __future__ import annotations

import numpy as np
import pytest

import slamgauge
from slamgauge.compare.estimators.adapters import adapt
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.ekf import SlamFilter, ekf_slam
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

from .conftest import Own, agree, short

pytestmark = pytest.mark.slow

ONLINE = """
from slamgauge.ekf import SlamFilter
made = []

class Mine(SlamFilter):
    def __init__(self, sensor, prior_mean, prior_cov):
        assert not made, "the module is not as new"
        made.append(1)
        super().__init__(sensor, prior_mean, prior_cov)
"""


def test_an_online_class(own: Own, capsys: pytest.CaptureFixture[str]):
    recording = short()
    estimate, reference = own(ONLINE, recording, "Mine"), ekf_slam(recording)
    agree(estimate, reference, atol=0.0)
    for name in ("association", "nis", "nis_dof"):
        assert np.array_equal(getattr(estimate, name), getattr(reference, name))
    assert "mine: online class Mine(sensor, prior_mean, prior_cov)\n" in capsys.readouterr().err


def test_an_online_class_without_arguments_and_map(own: Own):
    source = """
    import numpy as np
    class Mine:
        def __init__(self):
            self.pose, self.pose_cov = np.zeros(3), np.eye(3)
        def predict(self, increment, cov):
            self.pose = self.pose + increment
        def update(self, ids, values, covs):
            assert len(ids) == len(values) == len(covs)
    """
    recording = short()
    estimate = own(source, recording, "Mine")
    assert np.allclose(estimate.poses[-1], recording.odometry.sum(axis=0))
    assert (estimate.nis, estimate.association, len(estimate.landmarks)) == (None, None, 0)


@pytest.mark.parametrize(("asymmetry", "is_refused"), [(1e-9, False), (1e-4, True)])
def test_only_asymmetry_of_rounding_is_removed_from_covariances(asymmetry: float, is_refused: bool):
    class Mine(SlamFilter):
        pose_cov = property(lambda _: np.diag([1.0, 1.0, 0.1]) + asymmetry * np.eye(3, k=1))

    if is_refused:
        with pytest.raises(UserError, match="a covariance must be symmetric"):
            adapt(Mine, "mine")(short())
    else:
        assert adapt(Mine, "mine")(short()).pose_covs is not None


def test_a_callable_on_recordings_is_not_wrapped(capsys: pytest.CaptureFixture[str]):
    def estimate(recording: Recording, gate: float = 9.0) -> Estimate:  # noqa: ARG001
        return ekf_slam(recording)

    assert adapt(estimate, "mine")(short()) is not None
    assert adapt(ekf_slam, "mine") is ekf_slam
    assert capsys.readouterr().err == ""


def test_adapters_are_public():
    assert slamgauge.adapters.adapt is adapt
    assert {"adapt", "external", "step_function"} <= {*dir(slamgauge.adapters)}


def test_the_handout_scenario_has_the_numbers_of_the_handout():
    scenario = load_scenario("tp4-handout")
    _, recording = slamgauge.simulate(scenario, 0)
    assert (recording.steps, recording.observation_step[0], len(scenario.landmarks.positions)) == (800, 1, 4)
    assert np.allclose(np.diag(recording.odometry_cov[0]), 2 * np.array([0.03, 0.0, 0.1 * np.deg2rad(3.0)]) ** 2)
    assert np.allclose(np.diag(recording.observation_cov[0]), 2 * np.array([0.1, np.deg2rad(5.0)]) ** 2)
    assert recording.landmark is not None


@pytest.mark.parametrize(
    ("source", "lacks"),
    [
        ("def ekf_slam(x, P, z): ...", "the file has ekf_slam(x, P, z)"),
        ("def ekf_slam(x, P, u, z): ...", "DT, the length of a step [s], which it reads nowhere"),
        (
            "class ekf_slam:\n    def predict(self, v, w, dt): ...",
            "predict(increment, cov), update(observations), pose",
        ),
        (
            "class ekf_slam:\n    pose = (0, 0, 0)\n    def predict(self, u, Q): ...\n    def update(self, scan): ...",
            "it lacks pose_cov, properties or set by its constructor",
        ),
        (
            "class ekf_slam:\n    def __init__(self, Q, prior_mean): ...\n    def predict(self, u, Q): ...\n"
            "    def update(self, scan): ...",
            "it lacks a constructor without Q: it may have sensor, prior_mean, prior_cov",
        ),
    ],
)
def test_another_form_is_refused_with_what_it_lacks_and_the_wrapper(own: Own, source: str, lacks: str):
    with pytest.raises(UserError) as caught:
        own(source, short())
    assert lacks in str(caught.value)
    assert "class Wrapper:" in str(caught.value)
