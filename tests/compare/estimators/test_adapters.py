"""Forms of user filters: each is found by its signature, receives the data of the recording, and reports its map."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

import slamgauge
from slamgauge.compare.estimators.adapters import adapt
from slamgauge.compare.estimators.forms.octave_conventions import CourseObservation, turn
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.ekf import ekf_slam
from slamgauge.ekf.slam_filter import SlamFilter
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import compose

from .conftest import Own, agree, short

pytestmark = pytest.mark.slow

COURSE = """
import numpy as np
calls = []

def prediction_step(mu, sigma, u):
    calls.append("p")
    assert u[0] == u.r1 == u["r1"] and u[1] == u.t == u["t"]
    mu, a = mu.copy(), mu[2] + u.r1
    G = np.eye(len(mu))
    G[0, 2], G[1, 2] = -u.t * np.sin(a), u.t * np.cos(a)
    mu[0] += u.t * np.cos(a)
    mu[1] += u.t * np.sin(a)
    mu[2] += u["r1"] + u.r2
    return mu, G @ sigma @ G.T

def correction_step(mu, sigma, z, observed):
    assert set(calls) <= {"p"} and observed.dtype == bool
    for id, range, bearing in z:
        at = 3 + 2 * id
        if not observed[id]:
            mu[at] = mu[0] + range * np.cos(mu[2] + bearing)
            mu[at + 1] = mu[1] + range * np.sin(mu[2] + bearing)
            observed[id] = True
    return mu, sigma, observed
"""


@pytest.mark.parametrize("attribute", ["prediction_step", "correction_step"])
def test_the_functions_of_the_course(own: Own, capsys: pytest.CaptureFixture[str], attribute: str):
    """Landmarks stay at their first observed positions, in the order of first observation; the robot is uncorrected."""
    recording = short()
    assert recording.landmark is not None
    estimate = own(COURSE, recording, attribute)
    pose = recording.prior_mean
    for increment in recording.odometry:
        pose = compose(pose, increment)
    assert np.allclose(estimate.poses[-1], pose, rtol=0.0, atol=1e-12)
    assert estimate.landmark_ids.tolist() == [*dict.fromkeys(recording.landmark.tolist())]
    assert estimate.landmark_covs is not None
    assert (estimate.landmark_covs == 1000.0 * np.eye(2)).all()
    assert estimate.association is not None
    told = "functions of the Octave course, prediction_step (mu, sigma, u) and correction_step"
    assert capsys.readouterr().err.count(f"mine: {told}\n") == 1


@pytest.mark.parametrize(
    ("increment", "meant"),
    [
        ((1.0, 0.0, 0.2), (0.0, 1.0, 0.2)),
        ((-1.0, 0.0, 0.2), (0.0, -1.0, 0.2)),
        ((0.0, 2.0, 0.0), (1.5708, 2.0, -1.5708)),
    ],
)
def test_increments_as_turns_and_a_distance(increment: tuple[float, ...], meant: tuple[float, ...]):
    u = turn(np.array(increment))
    assert np.allclose(u, meant, atol=1e-4)
    moved = (u.t * np.cos(u.r1), u.t * np.sin(u.r1), u.r1 + u.r2)
    assert np.allclose(moved, increment)


def test_an_observation_has_its_fields_by_position_and_name():
    observation = CourseObservation(2, 3.0, 0.5)
    assert observation[0] == observation["id"] == observation.id == 2
    assert [*observation] == [2, 3.0, 0.5]


PAIR = """
import numpy as np
Q = np.eye(3)
R = np.eye(2)

def predict(eta, P, z_odo):
    c, s = np.cos(eta[2]), np.sin(eta[2])
    B = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    F = np.eye(3)
    F[:2, 2] = B[:2, :2] @ [-z_odo[1], z_odo[0]]
    return eta + B @ z_odo, F @ P @ F.T + B @ Q @ B.T

def update(eta, P, z):
    known = [[0.01, np.deg2rad(5) ** 2], [4e-4, 1e-4]]  # of the scenario, and of the tiny recording
    assert z.shape[1] == 2 and any(np.allclose(R, np.diag(each)) for each in known)
    return eta, P, 0.0, []
"""


def test_predict_and_update_without_corrections(own: Own, capsys: pytest.CaptureFixture[str]):
    """They agree with dead reckoning with the noise of the recording."""
    recording = short("q2-short-dense")
    estimate, known = own(PAIR, recording, "predict"), own(PAIR, short(), "update")
    blind = slamgauge.dead_reckoning(recording)
    for mine in (estimate, known):
        assert np.allclose(mine.poses, blind.poses, atol=1e-12)
        assert np.allclose(np.asarray(mine.pose_covs), np.asarray(blind.pose_covs), atol=1e-12)
        assert mine.association is None
    assert "mine: functions predict (eta, P, z_odo) and update (eta, P, z)\n" in capsys.readouterr().err


def test_landmark_numbers_of_predict_and_update_are_no_ids_of_the_recording(own: Own):
    source = PAIR.replace(
        "return eta, P, 0.0, []",
        "return (np.append(eta, [1.0, 2.0]), np.eye(5)) if len(eta) == 3 else (eta, P)",
    ).replace("return eta + B @ z_odo, F @ P @ F.T + B @ Q @ B.T", "return eta, P")
    assert own(source, short(), "predict").landmark_ids.tolist() == []
    unknown = own(source, short("q2-short-dense"), "predict")
    assert (unknown.landmark_ids.tolist(), unknown.landmarks.tolist()) == ([0], [[1.0, 2.0]])


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


MISNUMBERED = (
    COURSE.replace("at = 3 + 2 * id", "at = 1 + 2 * id")
    .replace("mu[at] =", "mu[5] =")
    .replace("mu[at + 1] =", "mu[6] =")
)
WITH_GATE = ONLINE.replace("prior_cov):", "prior_cov, gate):")


@pytest.mark.parametrize(
    ("source", "scenario", "attribute", "message"),
    [
        (
            MISNUMBERED,
            "q1-short-dense",
            "prediction_step",
            r"fits none .*; nearest to one, step \d: landmark \d+ was seen, but mu\[\d+:\d+\] is still zero",
        ),
        (COURSE, "q2-short-dense", "prediction_step", "need ids; give a recording that has them"),
        (WITH_GATE, "q1-short-dense", "Mine", "its constructor needs gate; take sensor, prior_mean, prior_cov"),
    ],
    ids=["landmarks numbered from 1", "no ids", "constructor with another argument"],
)
def test_code_that_cannot_run_on_a_recording(own: Own, source: str, scenario: str, attribute: str, message: str):
    with pytest.raises(slamgauge.UserError, match=message):
        own(source, short(scenario), attribute)


def test_a_callable_on_recordings_is_not_wrapped(capsys: pytest.CaptureFixture[str]):
    def estimate(recording: Recording, gate: float = 9.0) -> Estimate:  # noqa: ARG001
        return ekf_slam(recording)

    assert adapt(estimate, "mine")(short()) is not None
    assert adapt(ekf_slam, "mine") is ekf_slam
    assert capsys.readouterr().err == ""


def test_globals_of_a_callable_on_recordings_are_not_copied():
    class Large(list[int]):
        def __deepcopy__(self, memo: object) -> Large:
            raise AssertionError(memo)

    space: dict[str, object] = {"table": Large([1])}
    exec("def estimate(recording):\n    return table", space)
    given = space["estimate"]
    assert callable(given)
    assert adapt(given, "mine") is given


@pytest.mark.parametrize(("source", "name"), [(COURSE, "prediction_step"), (PAIR, "update")])
def test_a_given_function_brings_the_other_function_of_its_module(own: Own, source: str, name: str):
    space: dict[str, object] = {"__name__": "mine"}
    exec(source, space)
    given, recording = space[name], short()
    assert callable(given)
    agree(adapt(given, "mine")(recording), own(source, recording, name), atol=0.0)
    assert space.get("calls", []) == []


def test_the_callable_of_a_module_is_found():
    module = ModuleType("mine")
    vars(module)["estimate"] = ekf_slam
    assert adapt(module, "mine") is ekf_slam
    module = ModuleType("mine")
    vars(module)["Online"] = type("Online", (SlamFilter,), {"__module__": "mine"})
    agree(adapt(module, "mine")(short()), ekf_slam(short()), atol=0.0)
    with pytest.raises(
        slamgauge.UserError, match="module other has no estimate, ekf_slam, prediction_step, predict of"
    ):
        adapt(ModuleType("other"), "mine")


@pytest.mark.parametrize(
    ("source", "spelt"),
    [
        ("def ekf_slam(x, P): ...", r"ekf_slam\(x, P\)"),
        ("def ekf_slam(x, P, z): ...", r"ekf_slam\(x, P, z\)"),
        ("class ekf_slam: ...", r"class ekf_slam\("),
        ("def ekf_slam(a, b, c): ...\npredict = ekf_slam", r"ekf_slam\(a, b, c\)"),
    ],
)
def test_an_unknown_form_is_refused(own: Own, source: str, spelt: str):
    with pytest.raises(slamgauge.UserError, match=rf"estimator mine: {spelt}.* has none of the forms") as caught:
        own(source, short())
    line = str(caught.value)
    assert "\n" not in line
    forms = ("estimate(recording)", "class with predict", "prediction_step(", "predict(", "ekf_slam(xEst, PEst, u, y)")
    assert all(form in line for form in forms)


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


@pytest.mark.parametrize("parameters", ["recording", "recording=None"])
def test_the_estimate_of_a_module_may_have_a_default(parameters: str):
    module = ModuleType("mine")
    exec(f"def estimate({parameters}):\n    return recording", vars(module))
    assert adapt(module, "mine") is module.estimate


def test_a_named_callable_of_another_form_is_refused_with_the_known_forms():
    module = ModuleType("mine")
    exec("def estimate(a, b):\n    return a", vars(module))
    known = r"estimate\(a, b\) has none of the forms that are known; give estimate\(recording\), or"
    with pytest.raises(UserError, match=known):
        adapt(module, "mine")
