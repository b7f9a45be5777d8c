"""Step functions of the exercise: they receive exactly the noise of the recording, in all their variants."""

from __future__ import annotations

import ast
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

VARIANTS = ("wrong_jacobian", "no_cross_covariance", "no_wrap")

# corrects mapped landmarks of a scan in one update, then adds new ones, as `ekf` does
BLOCKED = """
import numpy as np
DT, Q, Py, KNOWN_DATA_ASSOCIATION, ids = 1.0, np.eye(2), np.eye(2), 1, []

def wrap(a):
    return (a + np.pi) % (2 * np.pi) - np.pi

def ekf_slam(xEst, PEst, u, y):
    assert KNOWN_DATA_ASSOCIATION == 1
    n, t, v = len(xEst), xEst[2, 0], u[0, 0] * DT
    A, B = np.eye(n), np.zeros((n, 2))
    A[:2, 2], B[:2, 0], B[2, 1] = [-v * np.sin(t), v * np.cos(t)], [DT * np.cos(t), DT * np.sin(t)], DT
    xEst[:3] += B[:3] @ u
    PEst = A @ PEst @ A.T + B @ Q @ B.T
    old = [yi for yi in y if yi[2] in ids]
    H, r = np.zeros((2 * len(old), n)), np.zeros((2 * len(old), 1))
    for k, yi in enumerate(old):
        at, rows = 3 + 2 * ids.index(yi[2]), slice(2 * k, 2 * k + 2)
        dx, dy = xEst[at : at + 2, 0] - xEst[:2, 0]
        d = np.hypot(dx, dy)
        G = np.array([[dx / d, dy / d], [-dy / d**2, dx / d**2]])
        H[rows, :2], H[rows, at : at + 2], H[2 * k + 1, 2] = -G, G, -1
        r[rows, 0] = [yi[0] - d, wrap(yi[1] - np.arctan2(dy, dx) + xEst[2, 0])]
    if old:
        K = PEst @ H.T @ np.linalg.inv(H @ PEst @ H.T + np.kron(np.eye(len(old)), Py))
        xEst, PEst = xEst + K @ r, PEst - K @ H @ PEst
    for yi in y:
        if yi[2] in ids:
            continue
        ids.append(yi[2])
        a = xEst[2, 0] + yi[1]
        e, f = np.array([[np.cos(a)], [np.sin(a)]]), yi[0] * np.array([[-np.sin(a)], [np.cos(a)]])
        J = np.zeros((2, len(xEst)))
        J[:, :2], J[:, 2:3], Jy = np.eye(2), f, np.hstack([e, f])
        PEst = np.block([[PEst, PEst @ J.T], [J @ PEst, J @ PEst @ J.T + Jy @ Py @ Jy.T]])
        xEst = np.vstack([xEst, xEst[:2] + yi[0] * e])
    return xEst, PEst
"""

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


def spy(statement: str) -> str:
    return SPY.format(statement)


@pytest.mark.parametrize("scenario", [("q1-short-dense", "trajectory.duration=20"), ("tp4-handout",)])
def test_a_textbook_function_equals_our_ekf(own: Own, capsys: pytest.CaptureFixture[str], scenario: tuple[str, ...]):
    """Both have the same motion model; they agree to rounding, map and scan at the start included."""
    recording = short(*scenario)
    assert (recording.observation_step[0] == 0) == (scenario[0] == "q1-short-dense")
    estimate, reference = own(BLOCKED, recording), ekf_slam(recording)
    agree(estimate, reference, atol=1e-6)
    assert np.array_equal(np.asarray(estimate.association), np.asarray(reference.association))
    assert "mine: step function of the exercise (xEst, PEst, u, y)\n" in capsys.readouterr().err


def example(name: str) -> slamgauge.Estimator:
    return load_estimators([f"mine={EXAMPLES / name}.py:ekf_slam"])["mine"]


@pytest.mark.parametrize(("scenario", "duration"), [("q1-long-dense", 20), ("q2-short-dense", 10)])
def test_the_example_equals_our_ekf(scenario: str, duration: int):
    """With ids `ekf` corrects with a whole scan; without, both use nearest neighbours one by one, with gate 9."""
    recording = short(scenario, f"trajectory.duration={duration}")
    if recording.landmark is not None:
        first = np.unique(recording.observation_step, return_index=True)[1]
        recording = recording.only(np.isin(np.arange(len(recording.observation)), first))
    agree(example("student_ekf")(recording), ekf_slam(recording), atol=1e-6)


def test_the_example_is_nearly_our_ekf():
    truth, recording = simulate(load_scenario("q1-short-dense", ["start=sampled"]), 0)
    mine, ours = (slamgauge.evaluate(truth, recording, each(recording)) for each in (example("student_ekf"), ekf_slam))
    assert mine["landmark_rmse_m"] is not None
    assert mine["ate_m"] is not None
    assert ours["ate_m"] is not None
    assert mine["landmarks_mapped"] == ours["landmarks_mapped"] == 18
    assert abs(mine["ate_m"] / ours["ate_m"] - 1) < 0.1


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_variants_have_one_bug_each(variant: str):
    right, wrong = ((EXAMPLES / f"student_ekf{name}.py").read_text().splitlines() for name in ("", f"_{variant}"))
    assert wrong[0].startswith("# WRONG ON PURPOSE: ")
    right, wrong = (lines[lines.index("import numpy as np") :] for lines in (right, wrong))
    changed = [line for line in difflib.ndiff(right, wrong) if line[0] in "+-"]
    assert 1 <= len(changed) <= 2
    recording = short("q1-long-dense", "trajectory.duration=35")
    poses = [example(f"student_ekf{name}")(recording).poses for name in ("", f"_{variant}")]
    assert np.abs(poses[0] - poses[1]).max() > 1e-4


def test_the_examples_name_their_variants():
    docstring = ast.get_docstring(ast.parse((EXAMPLES / "student_ekf.py").read_text()))
    assert docstring is not None
    assert all(f"student_ekf_{variant}.py" in docstring for variant in VARIANTS)


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
    assert recording.landmark is not None
    assert np.allclose(y, np.column_stack([recording.observation[seen], recording.landmark[seen]]))
    u, _, Q, Py, _, y = told[0]  # the first scan, before any motion
    assert not u.any()
    assert not Q.any()
    assert Py.any()
    assert len(y)


@pytest.mark.parametrize(
    ("scenario", "statement"),
    [
        ("q2-short-dense", "assert KNOWN_DATA_ASSOCIATION == 0 and (y[:, 2] == -1).all()"),
        ("tp4-handout", "told.append(1)\n    assert u.any()\n    assert y.shape[1] == 3"),
        (  # several members for a landmark: the state grows by more than the new landmarks
            "q1-short-dense",
            "if len(told) == 0:\n        told.append(1)\n        n = 4 * len(y)\n"
            "        xEst = np.vstack([xEst, np.zeros((n, 1))])\n        PEst = np.eye(3 + n)",
        ),
    ],
    ids=["unknown ids", "no scan at the start, no step", "members"],
)
def test_a_map_without_ids_is_not_reported(own: Own, scenario: str, statement: str):
    estimate = own(spy(statement), short(scenario))
    assert (len(estimate.poses), len(estimate.landmarks)) == (41, 0)
    assert estimate.association is None


def test_runs_share_no_globals_and_no_arrays(own: Own):
    source = spy("told.append(1)\n    xEst[0, 0] = len(told)\n    u += 1\n    y += 1\n    PEst *= 1\n    Q[:] = 9")
    recording = short()
    before = recording.odometry.copy()
    first, second = own(source, recording), own(source, recording)
    estimator = load_estimators(["mine=mine.py:ekf_slam"])["mine"]
    third, fourth = estimator(recording), estimator(recording)
    for estimate in (first, second, third, fourth):
        assert np.array_equal(estimate.poses[:, 0], np.arange(1, recording.steps + 2))
    assert np.array_equal(recording.odometry, before)


def test_runs_of_a_given_callable_share_no_globals():
    space: dict[str, object] = {}
    exec(spy("told.append(helper()); xEst[0, 0] = len(told)") + "\ndef helper(): return len(told)\n", space)
    given = space["ekf_slam"]
    assert isinstance(given, FunctionType)
    recording = short()
    estimator = step_function(given)
    assert estimator(recording).poses[-1, 0] == estimator(recording).poses[-1, 0] == recording.steps + 1
    assert space["told"] == []


def sideways(recording: Recording) -> Recording:
    odometry = recording.odometry.copy()
    odometry[6, 1] = 0.02
    return replace(recording, odometry=odometry)


def uneven(recording: Recording) -> Recording:
    cov = recording.observation_cov.copy()
    cov[1] = 2 * cov[0]
    return replace(recording, observation_cov=cov)


def positions(recording: Recording) -> Recording:
    return replace(recording, sensor="position")


def bearings(_: Recording) -> Recording:
    return short("q4-ring")


PARAMETERS = "u, y, M_DIST_TH, KNOWN_DATA_ASSOCIATION, Q, Py, verbose=False)"
WITH_SETTINGS = spy("assert M_DIST_TH == 4.0 and KNOWN_DATA_ASSOCIATION == 1 and Q[0, 0] < 1 and Py[0, 0] < 1").replace(
    "def ekf_slam(xEst, PEst, u, y)", f"M_DIST_TH = 4.0\ndef ekf_slam(xEst, PEst, {PARAMETERS}"
)
WITH_WEIGHTS = BEARING.format(Py="np.eye(1)", read="pass").replace("u, y, rays):", "u, y, rays, weights):")
BEARING_ONLY = "its Py is one variance, that of bearings, .* use `study` or `grade` on q4-ring, or write Py of 2 rows"


@pytest.mark.parametrize(
    ("source", "change", "message"),
    [
        (spy("1 / 0"), None, r"it raised ZeroDivisionError: .* \(mine.py, line 8\)"),
        (spy("return xEst"), None, "the step function returned a ndarray; return state and covariance"),
        (spy("return xEst, PEst[:2]"), None, r"step 0: returned xEst \(3, 1\) and PEst \(2, 3\); return"),
        (spy("return 'a', PEst"), None, "step 0: returned xEst"),
        (spy("return xEst * np.nan, PEst"), None, "step 0: xEst is not finite from here on"),
        (spy("pass"), sideways, r"step 7 moves 0\.02 m sideways"),
        (spy("pass"), uneven, "step 0: observations of one scan have different noise"),
        (f"{spy('pass')}\nPy = None\n", None, "its Py must be a square matrix of at least 2 rows"),
        (f"{spy('pass')}\nPy = 0.1\n", None, BEARING_ONLY),
        (f"{spy('pass')}\nPy = np.ones(2)\n", None, "its Py must be a square matrix of at least 2 rows"),
        (BEARING.format(Py="np.eye(1)", read="pass"), None, BEARING_ONLY),
        (spy("pass"), positions, ".*this recording has positions"),
        (WITH_WEIGHTS, bearings, "its parameter weights has no value at the start; give it a default"),
    ],
)
def test_errors_are_one_line(own: Own, source: str, change: Callable[[Recording], Recording] | None, message: str):
    recording = short() if change is None else change(short())
    with pytest.raises(slamgauge.UserError, match=f"^estimator mine: {message}") as caught:
        own(source, recording)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("source", [WITH_SETTINGS])
def test_settings_as_parameters(own: Own, source: str):
    own(source, short())


def test_the_noise_of_the_file_is_an_option(own: Own):
    """The first scan has no motion noise all the same."""
    wrapped = spy("told.append(1)\n    assert (Q == np.eye(2) * (len(told) > 1)).all() and (Py == np.eye(2)).all()")
    wrapped += "\nfrom slamgauge import adapters\nmine = adapters.step_function(ekf_slam, noise='file')\n"
    assert len(own(wrapped, short(), "mine").poses) == 41
    with pytest.raises(slamgauge.UserError, match="noise: 'mine' is not known; use 'recording' or 'file'"):
        step_function(ekf_slam, noise="mine")  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(slamgauge.UserError, match=r"step_function: ekf_slam\(recording, settings\) has another form"):
        step_function(ekf_slam)


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


@pytest.mark.parametrize(
    ("old", "new", "length"),
    [
        ("u, y, rays):", "u, y, rays=(5, 6)):", 2),
        (
            "Py, rays = np.eye(2), np.eye(1), [0]",
            "Py = np.eye(2), np.eye(1)\ndef main():\n    r = [7, 7, 7]\n    ekf_slam(0, 0, 0, 0, r)",
            3,
        ),
    ],
)
def test_the_third_value_begins_as_its_default_or_where_the_file_calls(own: Own, old: str, new: str, length: int):
    source = BEARING.format(Py="np.eye(1)", read="pass").replace(old, new)
    assert own(source, short("q4-ring")).poses[0, 0] == length


def test_a_third_value_without_a_start_is_named(own: Own):
    source = BEARING.format(Py="np.eye(1)", read="pass").replace("Py, rays = np.eye(2), np.eye(1), [0]", "Py = 1, 1")
    with pytest.raises(slamgauge.UserError, match="its parameter rays has no value at the start; give it a default"):
        own(source, short("q4-ring"))
