"""External programs: they read CSV files and write a CSV file, and every failure is one line."""

from __future__ import annotations

import sys
from pathlib import Path
from time import monotonic, sleep

import numpy as np
import pytest

import slamgauge
from slamgauge.compare.estimators.adapters import external
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

from .conftest import short

pytestmark = pytest.mark.slow

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
        (
            WRITE.format("step,x,y\n0,1,2\n"),
            "estimate.csv: line 1 is not the header of this file; write step,x,y",
        ),
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


def test_a_missing_program():
    estimator = external(["./no-such-slam", "{recording}", "{estimate}"])
    with pytest.raises(slamgauge.UserError, match=r"./no-such-slam cannot be started \(No such file or directory\)"):
        run_estimator("mine", estimator, short())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((["./my_slam", "{recording}"],), "has no word with {estimate}; give a list of words like"),
        (("./my_slam {recording} {estimate}",), "give a list of words"),
        ((["{recording}", "{estimate}"], 0.0), "timeout 0 s leaves no time"),
        ((["{recording}", "{estimate}"], 1.0, "best"), "kind 'best' is not known"),
    ],
)
def test_wrong_arguments_are_refused(arguments: tuple[object, ...], message: str):
    with pytest.raises(slamgauge.UserError, match=message):
        external(*arguments)  # pyrefly: ignore[bad-argument-type]
