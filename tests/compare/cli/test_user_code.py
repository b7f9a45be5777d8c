"""User code that fails, and user code in isolation: `--strict` and `--timeout`."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest

from slamgauge.compare.checks.examination import CHECKS, OVERDUE
from slamgauge.compare.cli.main import main
from tests.reference.command_line import run

pytestmark = pytest.mark.slow

RIGHT = """
from slamgauge import Estimate, chain
def estimate(recording):  # dead reckoning: a filter would load the compiler first, in every process
    return Estimate("filtered", chain(recording.prior_mean, recording.odometry))
"""
FILES = {
    "shifted": """
import numpy as np
from slamgauge import Estimate, chain
def estimate(recording):
    poses = chain(recording.prior_mean, recording.odometry)
    return Estimate("filtered", np.concatenate([poses[1:], poses[-1:]]))
""",
    "endless": "import time\ndef estimate(recording):\n    time.sleep(1000.0)\n",
    "blocked": f"""{RIGHT}
import time
right = estimate
def estimate(recording):
    time.sleep(0.0 if len(recording.observation) else 1000.0)
    return right(recording)
""",
    "right": RIGHT,
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with `FILES`."""
    for name, content in FILES.items():
        (tmp_path / f"{name}.py").write_text(content)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def own(*names: str) -> str:
    return ",".join(f"{name}={name}.py:estimate" for name in names)


def test_strict_and_timeout_of_a_run(folder: Path):
    words = ("run", "q1-short-dense", "--set", "trajectory.duration=4", "start=sampled", "--strict", "--no-report")
    for names, timeout, reason in (
        (("right", "shifted"), "60", "estimator shifted: uses the future: from the recording up to step "),
        (("endless",), "3", "estimator endless: it was not done after 3 s; make it faster, or give a longer --timeout"),
    ):
        estimators = f"ekf,{own(*names)}"
        assert main([*words, "--timeout", timeout, "--estimators", estimators, "--out", timeout]) == 1
        content = json.loads((folder / timeout / "metrics.json").read_text())
        assert content["estimators"].keys() == {"ekf", *names[:-1]}
        (failure,) = content["failures"]
        assert failure["error"].startswith(reason)


@pytest.mark.usefixtures("studies_in_a_thread", "empty_pictures")
def test_strict_of_a_study(folder: Path):
    words = ("--runs", "2", "--jobs", "1", "--estimators", f"ekf,{own('right', 'shifted')}", "--out", "study")
    for strict, expected in (((), set[str]()), (("--strict",), {"shifted"})):  # not one from the other's store
        command = ["study", "q1-short-dense", "--set", "trajectory.duration=4", *words, *strict]
        assert main(command) == (1 if expected else 0)
        content = json.loads((folder / "study/summary.json").read_text())
        assert {each["estimator"] for each in content["failures"]} == expected
        assert content["estimators"]["right"]["runs"] == 2


@pytest.mark.usefixtures("folder")
def test_check_ends_at_the_check_that_takes_too_long(capsys: pytest.CaptureFixture[str]):
    assert main(["check", own("blocked"), "--timeout", "5", "--json"]) == 1
    rows = json.loads(capsys.readouterr().out)
    first = [each.name for each in CHECKS].index("prediction-jacobian")  # the first one without observations
    assert rows[first]["passed"] is False
    assert rows[first]["blame"].startswith("estimator blocked: it was not done after 5 s; make it faster, ")
    assert len(rows) == len(CHECKS)
    assert {(each["passed"], each["blame"]) for each in rows[first + 1 :]} == {(None, f"not judged: {OVERDUE}")}


# --- code that fails ---------------------------------------------------------------------------

ESTIMATE = "from slamgauge import Estimate\nimport numpy as np\nimport sys\n\ndef estimate(recording):\n    "
BODIES = {
    "raise KeyError('gain\\nof\\nthe filter')": r"it raised KeyError: .*gain.* \(OWN.py, line 6\); mend it",
    "return None": "returned a NoneType; return a slamgauge.Estimate",
    "return Estimate('filtered', np.zeros((5, 3)))": "returned 5 poses; return 151, one for the start and one for",
    "return Estimate('filtered', np.full((151, 3), np.nan))": r"it raised UserError: poses\[0\] = \[nan, nan, nan\]: .*"
    r" \(OWN.py, line 6\); mend it and run again",
    "np.array([[0.0, np.ones(1)]])": r"it raised ValueError: .*inhomogeneous.* \(OWN.py, line 6\)",
    "recording.odometry[0] = 0.0": r"it raised ValueError: assignment destination is read-only \(OWN.py, line 6\)",
    "sys.exit()": r"it raised SystemExit: \(no message\) \(OWN.py, line 6\)",
}
MODULES = {
    "import sys\nsys.exit(0)": r"cannot be loaded, it raised SystemExit: 0 \(OWN.py, line 2\)",
    "def estimate(recording)\n": r"cannot be loaded, it raised SyntaxError: .*OWN.py, line 1\)",
    "%matplotlib inline": r"cannot be loaded, it raised SyntaxError: .*; remove the lines that only a notebook can run",
    "get_ipython()": r"cannot be loaded, it raised NameError: .*; remove the lines that only a notebook can run",
    "xrange(3)": r"cannot be loaded, it raised NameError: .*; this is code of Python 2; convert it to Python 3",
    "print 'a'": r"cannot be loaded, it raised SyntaxError: .*; this is code of Python 2; convert it to Python 3",
    "import nowhere_at_all": r"cannot be loaded, .*\(OWN.py, line 1\); install nowhere_at_all beside slamgauge, or",
    "def estimates(recording): ...": "OWN has no 'estimate'; did you mean estimates?",
    "estimate = 3": "is a int; give a callable Recording -> Estimate",
}


SOURCES = [*((ESTIMATE + body, message) for body, message in BODIES.items()), *MODULES.items()]


def test_estimators_that_fail_are_rows_with_their_reasons(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    names = [f"own_{number}" for number in range(len(SOURCES))]
    for name, (source, _) in zip(names, SOURCES, strict=True):
        (tmp_path / f"{name}.py").write_text(source)
    estimators = ",".join(["dead-reckoning", *(f"{name}:estimate" for name in names)])
    assert run("evaluate", stored / "recording.npz", "--estimators", estimators) == 1
    _, ours, *lines = capsys.readouterr().out.splitlines()
    assert ours.split()[:2] == ["dead-reckoning", "filtered"]
    failed = [line.split()[0] for line in lines if line.split()[1:2] == ["failed"]]
    assert sorted(failed) == sorted(f"{name}:estimate" for name in names)
    for name, (_, message) in zip(names, SOURCES, strict=True):
        reason = f"estimator {name}:estimate: {message.replace('OWN', name)}.*"
        assert any(re.fullmatch(reason, line) for line in lines), reason
