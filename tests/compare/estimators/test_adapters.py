"""Forms of user filters: each is found by its signature, receives the data of the recording, and reports its map.

External programs read CSV files and write a CSV file, and every failure is one line.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import numpy as np
import pytest

import slamgauge
from slamgauge.compare.checks.examination import check_estimator
from slamgauge.compare.estimators.adapters import adapt, external
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.estimators.running import run_estimator
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


def test_only_asymmetry_of_rounding_is_removed_from_covariances():
    class Mine(SlamFilter):
        asymmetry = 1e-9
        pose_cov = property(lambda self: np.diag([1.0, 1.0, 0.1]) + self.asymmetry * np.eye(3, k=1))

    assert adapt(Mine, "mine")(short()).pose_covs is not None
    Mine.asymmetry = 1e-4
    with pytest.raises(UserError, match="a covariance must be symmetric"):
        adapt(Mine, "mine")(short())


def test_a_callable_on_recordings_is_not_wrapped():
    def estimate(recording: Recording, gate: float = 9.0) -> Estimate:  # noqa: ARG001
        return ekf_slam(recording)

    assert adapt(estimate, "mine") is estimate
    assert slamgauge.adapters.adapt is adapt
    assert {"adapt", "external", "step_function"} <= {*dir(slamgauge.adapters)}


@pytest.mark.parametrize(
    ("source", "lacks"),
    [
        ("def ekf_slam(x, P, z): ...", "the file has ekf_slam(x, P, z)"),
        ("def ekf_slam(x, P, u, z): ...", "it lacks DT, the length of a step [s], which it reads nowhere: write DT"),
        (f"class ekf_slam:\n    pose = (0, 0, 0)\n{HALVES}", "it lacks pose_cov: properties (@property), or"),
        (f"class ekf_slam:\n    pose_cov = 1\n    def pose(self): ...\n{HALVES}", "it lacks pose: properties"),
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
    assert ("class Wrapper:" if source.startswith("class") else "def step(") in str(caught.value)


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
    assert [each.name for each in verdicts if each.limit_of_method] == ["standing-robot-in-noise"]
    assert len((EXAMPLES / "adapters" / f"{name}.py").read_text(encoding="utf-8").splitlines()) <= 40


def test_the_page_shows_an_adapter_with_numbers_of_its_lines():
    page = (EXAMPLES.parent / "docs/your_filter.md").read_text(encoding="utf-8")
    shown = page.split("```python\n")[1].split("```")[0]
    file = (EXAMPLES / "adapters/own_class.py").read_text(encoding="utf-8")
    code, ours = (re.sub(r"  # .*", "", each) for each in (shown, file))
    assert ours.endswith(f"\n{code}")


# --- external programs --------------------------------------------------------------------------

# dead reckoning in Python without numpy and slamgauge
PROGRAM = """
import csv, math, sys
folder, estimate = sys.argv[1:]
start = next(csv.DictReader(open(f"{folder}/start.csv")))
x, y, t = (float(start[name]) for name in ("x", "y", "theta"))
rows = [(0, x, y, t)]
for row in csv.DictReader(open(f"{folder}/odometry.csv")):
    dx, dy = float(row["dx"]), float(row["dy"])
    x, y = x + dx * math.cos(t) - dy * math.sin(t), y + dx * math.sin(t) + dy * math.cos(t)
    t += float(row["dtheta"])
    rows.append((row["step"], x, y, t))
with open(estimate, "w") as file:
    csv.writer(file).writerows([("step", "x", "y", "theta"), *rows])
"""


def run(tmp_path: Path, source: str, recording: Recording, timeout: float = 60.0) -> Estimate:
    program = tmp_path / "program.py"
    program.write_text(source)
    estimator = external([sys.executable, str(program), "{recording}", "{estimate}"], timeout)
    return run_estimator("mine", estimator, recording)[0]


def test_a_program_of_any_language(tmp_path: Path):
    recording = short()
    estimate = run(tmp_path, PROGRAM, recording)
    assert np.allclose(estimate.poses, slamgauge.dead_reckoning(recording).poses, atol=1e-12)
    assert (estimate.kind, estimate.pose_covs, estimate.association) == ("filtered", None, None)


def test_covariances_and_a_map(tmp_path: Path):
    recording = short()
    assert recording.landmark is not None
    ids = np.unique(recording.landmark)
    source = f"""
import os, sys
rows = "".join(f"{{step}},1,2,3,4,0.5,0,5,0.25,6\\n" for step in range({recording.steps + 1}))
open(sys.argv[2], "w").write("step,x,y,theta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt\\n" + rows)
rows = "".join(f"{{name}},{{name}},2,3,1,4\\n" for name in {ids.tolist()})
place = os.path.join(os.path.dirname(sys.argv[2]), "landmarks.csv")
open(place, "w").write("landmark,x,y,cov_xx,cov_xy,cov_yy\\n" + rows)
"""
    estimate = run(tmp_path, source, recording)
    assert np.asarray(estimate.pose_covs)[2].tolist() == [[4.0, 0.5, 0.0], [0.5, 5.0, 0.25], [0.0, 0.25, 6.0]]
    assert np.asarray(estimate.landmark_covs)[1].tolist() == [[3.0, 1.0], [1.0, 4.0]]
    assert np.array_equal(estimate.landmarks[:, 0], ids)
    assert np.array_equal(np.asarray(estimate.association), recording.landmark)


WRITE = "import sys\nopen(sys.argv[2], 'w').write({!r})\n"


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("import sys\nprint('no gate', file=sys.stderr)\nsys.exit(3)", "ended with status 3: no gate; mend it"),
        ("raise RuntimeError('lost')", "ended with status 1: RuntimeError: lost; mend it"),
        ("pass", r"has written no {estimate}; write the poses to that file"),
        (WRITE.format("step,x,y\n0,1,2\n"), "estimate.csv: line 1 is not the header of this file; write step,x"),
        (WRITE.format("step,x,y,theta\n0,0,0,nan\n"), "estimate.csv, line 2, column 4: 'nan' is not a finite number"),
        (WRITE.format("step,x,y,theta\n0,0,0,0\n2,0,0,0\n"), "estimate.csv, line 3: step 2, expected 1; sort the rows"),
        (WRITE.format("step,x,y,theta\n0,0,0,0\n"), "estimate.csv: has 1 rows; write 41, one for the start"),
    ],
)
def test_failures_are_one_line(tmp_path: Path, source: str, message: str):
    with pytest.raises(slamgauge.UserError, match=r"^estimator mine: [^\n]+$") as caught:
        run(tmp_path, source, short())
    assert message in str(caught.value)
    assert "slamgauge-" not in str(caught.value)


def test_an_endless_program_is_ended_with_its_children(tmp_path: Path):
    source = f"""
import subprocess, sys, time
child = "import time, pathlib; time.sleep(3); pathlib.Path({str(tmp_path / "alive")!r}).touch()"
subprocess.Popen([sys.executable, "-c", child])
time.sleep(60)
"""
    start = monotonic()
    with pytest.raises(slamgauge.UserError, match=r"was not done after 1 s; give a longer timeout"):
        run(tmp_path, source, short(), timeout=1.0)
    assert monotonic() - start < 30
    sleep(max(0.0, start + 5 - monotonic()))  # longer than the child would wait
    assert not (tmp_path / "alive").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((["./my_slam", "{recording}"],), "has no word with {estimate}; give a list of words like"),
        (("./my_slam {recording} {estimate}",), "give a list of words"),
        ((["{recording}", "{estimate}"], 0.0), "timeout 0 s leaves no time"),
        ((["{recording}", "{estimate}"], 1.0, "best"), "kind 'best' is not known"),
        ((["./no-slam", "{recording}{estimate}"],), r"./no-slam cannot be started \(No such file or directory\)"),
    ],
)
def test_wrong_arguments_and_missing_programs_are_refused(arguments: tuple[Any, ...], message: str):
    with pytest.raises(slamgauge.UserError, match=message):
        external(*arguments)(short())
