"""Step functions of the exercise: told the recording's noise exactly, and as many kinds of copies as there are."""

from __future__ import annotations

import ast
import difflib
import sys
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
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

from .conftest import Own, short

EXAMPLES = Path(__file__).parents[3] / "examples"
VARIANTS = ("wrong_jacobian", "no_cross_covariance", "no_wrap")

# a scan is taken in at once, as `ekf` does: first what is mapped, in one update, then what is new
BLOCKED = """
import numpy as np
DT, Q, Py, KNOWN_DATA_ASSOCIATION, ids = 1.0, np.eye(2), np.eye(2), 0, []

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

# what does nothing but look at what it is given
SPY = """
import numpy as np
DT, Q, Py, KNOWN_DATA_ASSOCIATION = 1.0, np.eye(2), np.eye(2), 7
told = []

def ekf_slam(xEst, PEst, u, y):
    {}
    return xEst, PEst
"""


def agree(one: Estimate, other: Estimate, atol: float = 1e-6) -> None:
    """Poses, covariances and maps."""
    for name in ("poses", "pose_covs", "landmarks", "landmark_covs"):
        assert np.allclose(getattr(one, name), getattr(other, name), rtol=0.0, atol=atol), name
    assert np.array_equal(one.landmark_ids, other.landmark_ids)


def spy(statement: str) -> str:
    return SPY.format(statement)


def test_a_textbook_one_is_our_ekf(own: Own, capsys: pytest.CaptureFixture[str]):
    """The same motion model, and scans from the start on: equal to rounding, map and all."""
    recording = short("q1-short-dense", "trajectory.duration=20")
    assert recording.observation_step[0] == 0
    estimate, reference = own(BLOCKED, recording), ekf_slam(recording)
    agree(estimate, reference)
    assert np.array_equal(np.asarray(estimate.association), np.asarray(reference.association))
    assert "mine: step function of the exercise (xEst, PEst, u, y)\n" in capsys.readouterr().err


def test_the_handout_feeds_it_as_its_own_simulation_does(own: Own):
    agree(own(BLOCKED, short("tp4-handout")), ekf_slam(short("tp4-handout")))


def example(name: str) -> slamgauge.Estimator:
    return load_estimators([f"mine={EXAMPLES / name}.py:ekf_slam"])["mine"]


def test_the_example_is_our_ekf_with_one_observation_a_scan():
    """With several it corrects with one after the other, which differs at second order."""
    recording = short("q1-long-dense", "trajectory.duration=20")
    first = np.unique(recording.observation_step, return_index=True)[1]
    recording = recording.only(np.isin(np.arange(len(recording.observation)), first))
    agree(example("student_ekf")(recording), ekf_slam(recording))


def test_the_example_is_our_ekf_with_its_own_nearest_neighbour():
    """Which is ours, too: observation by observation, at gate 9."""
    recording = short("q2-short-dense", "trajectory.duration=10")
    agree(example("student_ekf")(recording), ekf_slam(recording))


def test_the_example_is_nearly_our_ekf():
    truth, recording = simulate(load_scenario("q1-short-dense", ["start=sampled"]), 0)
    mine, ours = (slamgauge.evaluate(truth, recording, each(recording)) for each in (example("student_ekf"), ekf_slam))
    assert mine.landmark_rmse_m is not None
    assert mine.ate_m is not None
    assert ours.ate_m is not None
    assert mine.landmarks_mapped == ours.landmarks_mapped == 18
    assert abs(mine.ate_m / ours.ate_m - 1) < 0.1


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


def test_what_it_is_told(own: Own):
    """Speed and yaw rate, noise in their space, the covariance of ranges and bearings."""
    recording = short()
    source = spy("told.append((u, DT, Q, Py, KNOWN_DATA_ASSOCIATION, y))\n    open('told.txt', 'w').write(repr(told))")
    own(source, recording)
    space = {"array": np.array, "nan": np.nan}
    told = eval(Path("told.txt").read_text(), space)
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


def test_unknown_ids_say_nothing(own: Own):
    estimate = own(spy("assert KNOWN_DATA_ASSOCIATION == 0 and (y[:, 2] == -1).all()"), short("q2-short-dense"))
    assert estimate.association is None


def test_nothing_seen_at_the_start_is_no_step(own: Own):
    source = spy("told.append(1)\n    assert u.any()\n    assert y.shape[1] == 3")
    assert len(own(source, short("tp4-handout")).poses) == 41


def test_the_start_is_the_prior(own: Own):
    recording = short()
    estimate = own(spy("pass"), recording)
    assert np.array_equal(estimate.poses[0], recording.prior_mean)
    assert np.array_equal(np.asarray(estimate.pose_covs)[0], recording.prior_cov)


def test_runs_do_not_meet(own: Own):
    """Neither in global lists nor in arrays that are changed in place."""
    source = spy("told.append(1)\n    xEst[0, 0] = len(told)\n    u += 1\n    y += 1\n    PEst *= 1\n    Q[:] = 9")
    recording = short()
    before = recording.odometry.copy()
    first, second = own(source, recording), own(source, recording)
    estimator = load_estimators(["mine=mine.py:ekf_slam"])["mine"]
    third, fourth = estimator(recording), estimator(recording)
    for estimate in (first, second, third, fourth):
        assert np.array_equal(estimate.poses[:, 0], np.arange(1, recording.steps + 2))
    assert np.array_equal(recording.odometry, before)


def test_callables_at_hand_do_not_meet_either():
    space: dict[str, object] = {}
    exec(spy("told.append(helper()); xEst[0, 0] = len(told)") + "\ndef helper(): return len(told)\n", space)
    given = space["ekf_slam"]
    assert isinstance(given, FunctionType)
    recording = short()
    estimator = step_function(given)
    assert estimator(recording).poses[-1, 0] == estimator(recording).poses[-1, 0] == recording.steps + 1
    assert space["told"] == []


def test_a_simulation_that_runs_while_it_is_loaded_leaves_nothing_behind(own: Own, capfd: pytest.CaptureFixture[str]):
    """Figures, prints, an exit at the end, and ids of its own landmarks; one that exits before it is defined fails."""
    script = """
import matplotlib
matplotlib.use("TkAgg")
import matplotlib.pyplot as plt
figure, axes = plt.subplots()
for _ in range(3):
    x, P = np.zeros((3, 1)), np.eye(3)
    ekf_slam(x, P, np.zeros((2, 1)), np.array([[1.0, 0.0, 99.0]]))
    axes.plot([1, 2])
    plt.pause(1000)
print("done")
plt.show()
exit()
"""
    recording = short()
    mine = spy("told.append(len(told)); xEst[0, 0] = told[-1]") + script
    assert own(mine, recording).poses[0, 0] == 0.0
    printed = capfd.readouterr()
    assert printed.out == ""
    assert "done" in printed.err
    pyplot = sys.modules["matplotlib.pyplot"]
    assert pyplot.get_fignums() == []
    assert "estimators" not in pyplot.show.__module__
    with pytest.raises(slamgauge.UserError, match=r"cannot be loaded, it raised SystemExit: .*\(mine.py, line 2\)"):
        own("\nexit()\n" + BLOCKED, recording)


def test_old_numpy_is_told_by_its_line(own: Own):
    with pytest.raises(slamgauge.UserError) as caught:
        own(spy("v = float(u[0])"), short())
    line = str(caught.value)
    assert line.startswith(
        "estimator mine: mine.py, line 7: `v = float(u[0])` takes an array for a number, which numpy "
    )
    assert line.endswith("; write the element, u[0, 0] for u[0] of a column")


def test_other_errors_keep_their_names(own: Own):
    with pytest.raises(slamgauge.UserError, match=r"it raised ZeroDivisionError: .* \(mine.py, line 7\)"):
        own(spy("1 / 0"), short())


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("return xEst", "the step function returned a ndarray; return state and covariance"),
        ("return xEst, PEst[:2]", r"step 0: returned xEst \(3, 1\) and PEst \(2, 3\); return"),
        ("return 'a', PEst", "step 0: returned xEst"),
        ("return xEst * np.nan, PEst", "step 0: xEst is not finite from here on"),
    ],
)
def test_what_is_no_state(own: Own, statement: str, message: str):
    with pytest.raises(slamgauge.UserError, match=f"estimator mine: {message}") as caught:
        own(spy(statement), short())
    assert "\n" not in str(caught.value)


def test_its_own_noise_is_a_choice(own: Own):
    """The first scan is fed without motion noise all the same."""
    wrapped = spy("told.append(1)\n    assert (Q == np.eye(2) * (len(told) > 1)).all() and (Py == np.eye(2)).all()")
    wrapped += "\nfrom slamgauge import adapters\nmine = adapters.step_function(ekf_slam, noise='file')\n"
    assert len(own(wrapped, short(), "mine").poses) == 41
    with pytest.raises(slamgauge.UserError, match="noise: 'mine' is not known; use 'recording' or 'file'"):
        step_function(ekf_slam, noise="mine")  # pyright: ignore[reportArgumentType]
    with pytest.raises(slamgauge.UserError, match=r"step_function: ekf_slam\(recording\) has another form"):
        step_function(ekf_slam)


def test_noise_that_it_would_not_notice(own: Own):
    with pytest.raises(
        slamgauge.UserError, match="has no global Q and no Py; call them so, or take its own noise, slam"
    ):
        own(spy("pass").replace("Q, Py", "Cx, R"), short())
    with pytest.raises(slamgauge.UserError, match="has no global DT; let it read them"):
        own(spy("pass").replace("DT", "dt"), short())


def test_what_cannot_be_said(own: Own):
    recording = short()
    odometry, cov = recording.odometry.copy(), recording.observation_cov.copy()
    odometry[6, 1], cov[1] = 0.02, 2 * cov[0]
    with pytest.raises(slamgauge.UserError, match=r"step 7 moves 0\.02 m sideways"):
        own(spy("pass"), replace(recording, odometry=odometry))
    with pytest.raises(slamgauge.UserError, match="step 0: observations of one scan have different noise"):
        own(spy("pass"), replace(recording, observation_cov=cov))
    for Py in ("None", "0.1", "np.ones(2)", "np.eye(1)"):
        with pytest.raises(slamgauge.UserError, match="its Py must be a square matrix of at least 2 rows"):
            own(f"{spy('pass')}\nPy = {Py}\n", recording)
    positions = replace(recording, sensor="position")
    with pytest.raises(slamgauge.UserError, match="this recording has positions"):
        own(spy("pass"), positions)


def test_settings_as_parameters(own: Own):
    source = spy("assert gate and KNOWN == 1").replace(
        "def ekf_slam(xEst, PEst, u, y)",
        "M_DIST_TH = 4.0\ndef ekf_slam(xEst, PEst, u, y, M_DIST_TH, KNOWN_DATA_ASSOCIATION, Q, Py, verbose=False)",
    )
    statement = "assert M_DIST_TH == 4.0 and KNOWN_DATA_ASSOCIATION == 1 and Q[0, 0] < 1 and Py[0, 0] < 1"
    source = source.replace("assert gate and KNOWN == 1", statement)
    own(source, short())
    with pytest.raises(
        slamgauge.UserError, match="no global has the value of its parameter M_DIST_TH; give it a default"
    ):
        own(source.replace("M_DIST_TH = 4.0", "").replace("M_DIST_TH == 4.0 and", ""), short())


BEARING = """
import numpy as np
DT, Q, Py, rays = 0.1, np.eye(2), {Py}, [0]

def ekf_slam(xEst, PEst, u, y, rays):
    {read}
    xEst[0, 0] = len(rays)
    return xEst, PEst, [*rays, 1]
"""


@pytest.mark.parametrize(
    ("Py", "read"),
    [
        ("np.eye(1)", "assert y.shape[1] == 2 and (abs(y[:, 0]) < 4).all() and Py.shape == (1, 1) and Py < 0.01"),
        ("np.eye(2)", "assert y.shape[1] == 3 and (y[:, 2] >= 0).all() and (Py.diagonal() < [2, 0.01]).all()"),
        ("np.eye(2)", "assert y.shape == (len(y), 3) and np.isnan(y).sum() == len(y)"),
        ("np.eye(2)", "assert (y[:, 1] >= 0).all() and y.shape[1] == 2"),
        ("np.eye(2)", "assert y.shape == (len(y), 3) and y[:, 0:3].size == y.size"),
    ],
)
def test_bearings_alone(own: Own, Py: str, read: str):
    """With or without a column for the range, as the code reads it; the third value is passed on."""
    recording = short("q4-ring")
    estimate = own(BEARING.format(Py=Py, read=read), recording)
    assert np.array_equal(estimate.poses[:, 0], np.arange(1, recording.steps + 2))
    assert (len(estimate.landmarks), estimate.association) == (0, None)  # nobody can name what it has not mapped


def test_the_third_value_begins_as_its_default_or_empty(own: Own):
    source = BEARING.format(Py="np.eye(1)", read="pass")
    default = source.replace("u, y, rays):", "u, y, rays=(5, 6)):")
    assert own(default, short("q4-ring")).poses[0, 0] == 2
    nothing = source.replace("Py, rays = ", "Py, other = ")
    assert own(nothing, short("q4-ring")).poses[0, 0] == 0
    two = source.replace("u, y, rays):", "u, y, rays, weights):")
    with pytest.raises(slamgauge.UserError, match="parameters rays, weights: only one value can be passed on"):
        own(two, short("q4-ring"))


def test_a_map_that_nobody_can_name_is_not_reported(own: Own):
    """Two members for a landmark, as rays have: the state grows by more than what is new."""
    source = spy(
        "if len(told) == 0:\n        told.append(1)\n        n = 4 * len(y)\n"
        "        xEst = np.vstack([xEst, np.zeros((n, 1))])\n        PEst = np.eye(3 + n)"
    )
    recording: Recording = short()
    estimate = own(source, recording)
    assert (len(estimate.landmarks), estimate.association) == (0, None)


def test_the_examples_say_how_they_are_graded():
    docstring = ast.get_docstring(ast.parse((EXAMPLES / "student_ekf.py").read_text()))
    assert docstring is not None
    assert all(f"student_ekf_{variant}.py" in docstring for variant in VARIANTS)
