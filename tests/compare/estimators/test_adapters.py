"""Forms of user filters: each is found by its signature, receives the data of the recording, and reports its map."""

from __future__ import annotations

import re

import numpy as np
import pytest

import slamgauge
from slamgauge.compare.checks.examination import check_estimator
from slamgauge.compare.estimators.adapters import adapt
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.ekf import SlamFilter, ekf_slam
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

from .conftest import EXAMPLES, Own, agree, short

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
PLAIN = """
import numpy as np
class Mine:
    def __init__(self):
        self.pose, self.pose_cov = np.zeros(3), np.eye(3)
    def predict(self, increment, cov):
        self.pose = self.pose + increment
    def update(self, ids, values, covs):
        assert len(ids) == len(values) == len(covs)
"""
HALVES = "    def predict(self, u, Q): ...\n    def update(self, scan): ...\n"
ADAPTERS = {"octave_course": "estimate", "ntnu_class": "Ntnu", "own_class": "Wrapper"}
LIMIT = "standing-robot-in-noise"  # a limit of the textbook method


def test_an_online_class_with_and_without_arguments_and_map(own: Own, capsys: pytest.CaptureFixture[str]):
    recording = short()
    estimate, reference = own(ONLINE, recording, "Mine"), ekf_slam(recording)
    agree(estimate, reference, atol=0.0)
    for name in ("association", "nis", "nis_dof"):
        assert np.array_equal(getattr(estimate, name), getattr(reference, name))
    assert "mine: online class Mine(sensor, prior_mean, prior_cov)\n" in capsys.readouterr().err
    estimate = own(PLAIN, recording, "Mine")
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

    assert adapt(estimate, "mine") is estimate
    assert capsys.readouterr().err == ""
    assert slamgauge.adapters.adapt is adapt
    assert {"adapt", "external", "step_function"} <= {*dir(slamgauge.adapters)}


@pytest.mark.parametrize(
    ("source", "lacks"),
    [
        ("def ekf_slam(x, P, z): ...", "the file has ekf_slam(x, P, z)"),
        ("def ekf_slam(x, P, u, z): ...", "it lacks DT, the length of a step [s], which it reads nowhere: write DT"),
        (
            "class ekf_slam:\n    def predict(self, v): ...",
            "it lacks predict(increment, cov), update(observations), pose",
        ),
        (f"class ekf_slam:\n    pose = (0, 0, 0)\n{HALVES}", "it lacks pose_cov, properties or set by its constructor"),
        (
            f"class ekf_slam:\n    def __init__(self, Q, prior_mean): ...\n{HALVES}",
            "it lacks a constructor without Q: it may have sensor, prior_mean, prior_cov",
        ),
    ],
)
def test_another_form_is_refused_with_what_it_lacks_and_the_wrapper(own: Own, source: str, lacks: str):
    with pytest.raises(UserError) as caught:
        own(source, short())
    assert lacks in str(caught.value)
    assert "class Wrapper:" in str(caught.value)


@pytest.mark.parametrize("name", ADAPTERS)
def test_an_example_equals_our_ekf_passes_every_check_and_is_short(name: str):
    estimator = load_estimators([f"mine={EXAMPLES}/adapters/{name}.py:{ADAPTERS[name]}"])["mine"]
    recording = simulate(load_scenario("q1-short-dense", ["start=sampled"]), 3)[1]
    mine, ours = estimator(recording), ekf_slam(recording)
    assert np.abs(mine.poses - ours.poses).max() < 1e-9
    assert np.abs(np.asarray(mine.pose_covs) - np.asarray(ours.pose_covs)).max() < 1e-9
    order = [mine.landmark_ids.tolist().index(each) for each in ours.landmark_ids]
    assert np.abs(mine.landmarks[order] - ours.landmarks).max() < 1e-9
    verdicts = check_estimator("mine", estimator)
    assert [each.name for each in verdicts if each.is_failure] == []
    assert [each.name for each in verdicts if each.limit_of_method] == [LIMIT]
    assert len((EXAMPLES / "adapters" / f"{name}.py").read_text(encoding="utf-8").splitlines()) <= 40


def test_the_page_shows_an_adapter_with_numbers_of_its_lines():
    page = (EXAMPLES.parent / "docs/your_filter.md").read_text(encoding="utf-8")
    shown = page.split("```python\n")[1].split("```")[0]
    file = (EXAMPLES / "adapters/own_class.py").read_text(encoding="utf-8")
    code, ours = (re.sub(r"  # .*", "", each) for each in (shown, file))
    assert ours.endswith(f"\n{code}")
