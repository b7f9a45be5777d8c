"""Step functions of the exercise: they receive exactly the noise of the recording, in all their variants."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import FunctionType

import numpy as np
import pytest

import slamgauge
from slamgauge.compare.estimators.adapters import step_function
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.ekf import ekf_slam
from slamgauge.recording import Recording

from .conftest import EXAMPLES, Own, agree, short

pytestmark = pytest.mark.slow

# leaves the state as it is
SPY = """
import numpy as np
DT, Q, Py, KNOWN_DATA_ASSOCIATION = 1.0, np.eye(2), np.eye(2), 7
told = []

def ekf_slam(xEst, PEst, u, y):
    moved = u * DT
    {}
    return xEst, PEst
"""
BEARING = """
import numpy as np
DT = 0.1
Q, Py, rays = np.eye(2), {Py}, [0]

def ekf_slam(xEst, PEst, u, y, rays):
    moved = u * DT
    {read}
    xEst[0, 0] = len(rays)
    return xEst, PEst, [*rays, 1]
"""


spy = SPY.format


def example(name: str) -> slamgauge.Estimator:
    return load_estimators([f"mine={EXAMPLES / name}.py:ekf_slam"])["mine"]


@pytest.mark.parametrize(("scenario", "seconds"), [("q1-long-dense", 20), ("q2-short-dense", 10), ("tp4-handout", 10)])
def test_the_example_equals_our_ekf(scenario: str, seconds: int, capsys: pytest.CaptureFixture[str]):
    """With ids `ekf` corrects with a whole scan; without, both use nearest neighbours one by one, with gate 9."""
    recording = short(scenario, f"trajectory.duration={seconds}")
    if recording.landmark is not None:
        first = np.unique(recording.observation_step, return_index=True)[1]
        recording = recording.only(np.isin(np.arange(len(recording.observation)), first))
    assert (recording.observation_step[0] == 0) == (scenario != "tp4-handout")
    estimate, reference = example("student_ekf")(recording), ekf_slam(recording)
    agree(estimate, reference, atol=1e-9)
    if recording.landmark is not None:
        assert np.array_equal(np.asarray(estimate.association), np.asarray(reference.association))
    assert "mine: step function of the exercise (xEst, PEst, u, y)\n" in capsys.readouterr().err


@pytest.mark.parametrize("variant", ["wrong_jacobian", "no_cross_covariance", "no_wrap"])
def test_the_variants_have_one_bug_each(variant: str):
    names = ("student_ekf", f"student_ekf_{variant}")
    right, wrong = ((EXAMPLES / f"{name}.py").read_text().splitlines() for name in names)
    assert wrong[0].startswith("# WRONG ON PURPOSE: ")
    assert f"{names[1]}.py" in "".join(right[: right.index("import numpy as np")])
    right, wrong = (lines[lines.index("import numpy as np") :] for lines in (right, wrong))
    assert 1 <= len([line for line in difflib.ndiff(right, wrong) if line[0] in "+-"]) <= 2
    recording = short("q1-long-dense", "trajectory.duration=35")
    poses = [example(name)(recording).poses for name in names]
    assert np.abs(poses[0] - poses[1]).max() > 1e-4


def test_arguments_and_globals_of_a_step(own: Own):
    """They are speed and yaw rate, their noise, and the covariance of ranges and bearings."""
    recording = short()
    source = spy("told.append((u, DT, Q, Py, KNOWN_DATA_ASSOCIATION, y))\n    open('told.txt', 'w').write(repr(told))")
    estimate = own(source, recording)
    assert np.array_equal(estimate.poses[0], recording.prior_mean)
    assert np.array_equal(np.asarray(estimate.pose_covs)[0], recording.prior_cov)
    told = eval(Path("told.txt").read_text(), {"array": np.array, "Column": np.array, "nan": np.nan})
    u, dt, Q, Py, known, y = told[5]
    assert (dt, known) == (pytest.approx(0.1), 1)
    assert np.allclose(u[:, 0] * dt, recording.odometry[4, [0, 2]])
    assert np.allclose(Q * dt**2, recording.odometry_cov[4][np.ix_([0, 2], [0, 2])])
    assert np.allclose(Py, recording.observation_cov[0])
    seen = recording.observation_step == 5
    assert np.allclose(y[:, :2], recording.observation[seen])
    assert np.array_equal(y[:, 2], np.asarray(recording.landmark)[seen])
    u, _, Q, Py, _, y = told[0]  # the first scan, before any motion
    assert (u.any(), Q.any(), Py.any(), len(y) > 0) == (False, False, True, True)


MEMBERS = """if not told:
        told.append(1)
        xEst = np.vstack([xEst, np.zeros((4 * len(y), 1))])
        PEst = np.eye(len(xEst))"""


@pytest.mark.parametrize(
    ("scenario", "statement"),
    [
        ("q2-short-dense", "assert KNOWN_DATA_ASSOCIATION == 0 and (y[:, 2] == -1).all()"),
        ("tp4-handout", "told.append(1)\n    assert u.any()\n    assert y.shape[1] == 3"),
        ("q1-short-dense", MEMBERS),  # the state grows by more than the new landmarks
    ],
    ids=["unknown ids", "no scan at the start, no step", "members"],
)
def test_a_map_without_ids_is_not_reported(own: Own, scenario: str, statement: str):
    estimate = own(spy(statement), short(scenario))
    assert (len(estimate.poses), len(estimate.landmarks), estimate.association) == (41, 0, None)


def test_runs_share_no_globals_and_no_arrays(own: Own):
    source = spy("told.append(1)\n    xEst[0, 0] = len(told)\n    u += 1\n    y += 1\n    PEst *= 1\n    Q[:] = 9")
    recording = short()
    before = recording.odometry.copy()
    estimates = [own(source, recording)]
    estimator = load_estimators(["mine=mine.py:ekf_slam"])["mine"]
    space: dict[str, object] = {}
    exec(source, space)
    given = space["ekf_slam"]
    assert isinstance(given, FunctionType)
    estimates += [each(recording) for each in (estimator, estimator, step_function(given), step_function(given))]
    for estimate in estimates:
        assert np.array_equal(estimate.poses[:, 0], np.arange(1, recording.steps + 2))
    assert np.array_equal(recording.odometry, before)
    assert space["told"] == []


@pytest.mark.parametrize("read", ["math.cos(xEst[2])", "float(u[0])", "int(xEst[0] + u[1])"])
def test_elements_of_columns_are_numbers_as_before_numpy_2_4(own: Own, read: str):
    """The run begins again as new, with columns that convert."""
    source = spy(f"import math\n    told.append({read})\n    xEst[0, 0] = len(told)")
    assert own(source, short()).poses[-1, 0] == short().steps + 1


SIDEWAYS = np.outer(np.arange(40) == 6, [0.0, 0.02, 0.0])
UNEVEN = np.linspace(1.0, 2.0, 1000)[:, None, None]
CHANGES: dict[str, Callable[[Recording], Recording]] = {
    "": lambda recording: recording,
    "sideways": lambda recording: replace(recording, odometry=recording.odometry + SIDEWAYS),
    "uneven": lambda each: replace(each, observation_cov=each.observation_cov * UNEVEN[: len(each.observation)]),
    "positions": lambda recording: replace(recording, sensor="position"),
    "bearings": lambda _: short("q4-ring"),
}
WITH_WEIGHTS = BEARING.format(Py="np.eye(1)", read="pass").replace("u, y, rays):", "u, y, rays, weights):")
BEARING_ONLY = "its Py is one variance, that of bearings, .* use `study` or `grade` on q4-ring, or write Py of 2 rows"


@pytest.mark.parametrize(
    ("source", "change", "message"),
    [
        (spy("1 / 0"), "", r"it raised ZeroDivisionError: .* \(mine.py, line 8\)"),
        (spy("return xEst"), "", "the step function returned one array; return state and covariance"),
        (spy("return xEst, PEst[:2]"), "", r"step 0: returned xEst \(3, 1\) and PEst \(2, 3\); return"),
        (spy("return 'a', PEst"), "", "step 0: returned xEst"),
        (spy("return xEst * np.nan, PEst"), "", "step 0: xEst is not finite from here on"),
        (spy("pass"), "sideways", r"step 7 moves 0\.02 m sideways"),
        (spy("pass"), "uneven", "step 0: observations of one scan have different noise"),
        (f"{spy('pass')}\nPy = None\n", "", "its Py must be a square matrix of at least 2 rows"),
        (f"{spy('pass')}\nPy = 0.1\n", "", BEARING_ONLY),
        (f"{spy('pass')}\nPy = np.ones(2)\n", "", "its Py must be a square matrix of at least 2 rows"),
        (BEARING.format(Py="np.eye(1)", read="pass"), "", BEARING_ONLY),
        (spy("pass"), "positions", ".*this recording has positions"),
        (WITH_WEIGHTS, "bearings", "its parameter weights has no value at the start; give it a default"),
        (f"weights = [1]\n{WITH_WEIGHTS}", "bearings", "it returns 1 of the values for rays, weights; return all"),
    ],
)
def test_errors_are_one_line(own: Own, source: str, change: str, message: str):
    with pytest.raises(slamgauge.UserError, match=f"^estimator mine: {message}[^\n]*$"):
        own(source, CHANGES[change](short()))


def test_the_handout_scenario_has_the_numbers_of_the_handout():
    recording = simulate(load_scenario("tp4-handout"), 0)[1]
    assert (recording.steps, recording.observation_step[0], len({*np.asarray(recording.landmark)})) == (800, 1, 4)
    assert np.allclose(np.diag(recording.odometry_cov[0]), 2 * np.array([0.03, 0.0, 0.1 * np.deg2rad(3.0)]) ** 2)
    assert np.allclose(np.diag(recording.observation_cov[0]), 2 * np.array([0.1, np.deg2rad(5.0)]) ** 2)


def test_settings_as_parameters(own: Own):
    source = spy("assert M_DIST_TH == 4.0 and KNOWN_DATA_ASSOCIATION == 1 and Q[0, 0] < 1 and Py[0, 0] < 1")
    names = "u, y, M_DIST_TH, KNOWN_DATA_ASSOCIATION, Q, Py, verbose=False)"
    own(f"M_DIST_TH = 4.0\n{source.replace('u, y)', names)}", short())


def test_the_noise_of_the_file_is_an_option(own: Own):
    """The first scan has no motion noise all the same."""
    wrapped = spy("told.append(1)\n    assert (Q == np.eye(2) * (len(told) > 1)).all() and (Py == np.eye(2)).all()")
    wrapped += "\nfrom slamgauge import adapters\nmine = adapters.step_function(ekf_slam, noise='file')\n"
    assert len(own(wrapped, short(), "mine").poses) == 41
    with pytest.raises(slamgauge.UserError, match="noise: 'mine' is not known; use 'recording' or 'file'"):
        step_function(ekf_slam, noise="mine")  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(slamgauge.UserError, match=r"step_function: ekf_slam\(recording, settings\) has another form"):
        step_function(ekf_slam)


def test_noise_of_motion_and_observations_in_one_matrix_is_kept_at_every_step(own: Own):
    """PythonRobotics' Cx, which a scan at step 0 needs, too."""
    source = spy("told.append(1)\n    assert (Cx == np.eye(3)).all() and len(told) < 42")
    estimate = own(source.replace("Q, Py", "Cx, M_DIST_TH").replace("np.eye(2), np.eye(2)", "np.eye(3), 2.0"), short())
    assert len(estimate.poses) == 41


@pytest.mark.parametrize(
    ("Py", "read"),
    [
        ("np.eye(1)", "assert y.shape[1] == 2 and (abs(y[:, 0]) < 4).all() and Py.shape == (1, 1) and Py < 0.01"),
        ("0.1", "assert y.shape[1] == 2 and np.ndim(Py) == 0 and Py < 0.01"),
        ("np.eye(2)", "assert y.shape[1] == 3 and (y[:, 2] >= 0).all() and (Py.diagonal() < [2, 0.01]).all()"),
        ("np.eye(2)", "assert y.shape == (len(y), 3) and np.isnan(y).sum() == len(y)"),
        ("np.eye(2)", "assert (y[:, 1] >= 0).all() and y.shape[1] == 2"),
        ("np.eye(2)", "assert y.shape == (len(y), 3) and y[:, 0:3].size == y.size"),
    ],
)
def test_bearing_only_functions_have_the_columns_that_they_read(own: Own, Py: str, read: str):
    """They pass on their third value, and report no map, whose ids are unknown."""
    recording = short("q4-ring")
    estimate = own(BEARING.format(Py=Py, read=read), recording)
    assert np.array_equal(estimate.poses[:, 0], np.arange(1, recording.steps + 2))
    assert (len(estimate.landmarks), estimate.association) == (0, None)


CALLED = "Py = np.eye(2), np.eye(1)\ndef main():\n    r = [7, 7, 7]\n    ekf_slam(0, 0, 0, 0, r)"


@pytest.mark.parametrize(
    ("old", "new", "length"),
    [("u, y, rays):", "u, y, rays=(5, 6)):", 2), ("Py, rays = np.eye(2), np.eye(1), [0]", CALLED, 3)],
)
def test_the_third_value_begins_as_its_default_or_where_the_file_calls(own: Own, old: str, new: str, length: int):
    source = BEARING.format(Py="np.eye(1)", read="pass").replace(old, new)
    assert own(source, short("q4-ring")).poses[0, 0] == length
