"""The main commands run without `fcntl`, `resource`, `pwd`, GTSAM and the other things that Windows lacks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

BLOCKED = Path(__file__).parents[2] / "like_windows"
SHORT = ["--set", "trajectory.duration=5"]
COMMANDS = {
    "scenarios": ["scenarios"],
    "run": ["run", "q1-short-dense", *SHORT, "--estimators", "ekf,causal,batch", "--out", "new"],
    "evaluate": ["evaluate", "run/recording.npz", "--truth", "run/truth.npz", "--estimators", "ekf,mine.py:estimate"],
    "study": ["study", "q1-short-dense", *SHORT, "--runs", "3", "--jobs", "2", "--estimators", "ekf", "--out", "new"],
    "check": ["check", "mine.py:estimate"],
    "noise": ["noise", "run/recording.npz", "--out", "new"],
    "export": ["export", "run", "--format", "csv", "--out", "new"],
    "import": ["import", "csv", "log", "--out", "new"],
    "bench": ["bench", "--landmarks", "5", "--estimators", "ekf"],
    "doctor": ["doctor"],
}
MINE = "import slamgauge\n\n\ndef estimate(recording):\n    return slamgauge.ekf_slam(recording)\n"


def slamgauge(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command in `folder` with the modules blocked."""
    return subprocess.run(
        [sys.executable, "-m", "slamgauge", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(BLOCKED), "PYTHONWARNINGS": "ignore"},  # filelock warns on Linux alone
        check=False,
        capture_output=True,
        text=True,
        timeout=300,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a user file, the results of a run and a CSV log."""
    folder = tmp_path_factory.mktemp("windows")
    (folder / "mine.py").write_text(MINE)
    for words in ([*COMMANDS["run"][:-1], "run"], ["export", "run", "--format", "csv", "--out", "log"]):
        done = slamgauge(folder, *words)
        assert done.returncode == 0, done.stderr
    return folder


def test_the_modules_are_blocked(folder: Path):
    program = "import importlib.util, sys; sys.exit(any(sys.modules.get(n, 0) is not None for n in ('fcntl', 'gtsam')))"
    environment = {**os.environ, "PYTHONPATH": str(BLOCKED)}
    assert subprocess.run([sys.executable, "-c", program], cwd=folder, env=environment, check=False).returncode == 0


@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "run"])
def test_a_command_runs(folder: Path, tmp_path: Path, command: str):
    words = [str(tmp_path / word) if word == "new" else word for word in COMMANDS[command]]
    done = slamgauge(folder, *words)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("words", "remedy"),
    [
        (["grade", ".", "--scenario", "q1-short-dense"], "grade on Linux or macOS"),
        (["study", "q1-short-dense", "--estimators", "mine.py:estimate", "--strict"], "leave out --strict"),
    ],
)
def test_isolation_is_refused_in_one_line(folder: Path, words: list[str], remedy: str):
    done = slamgauge(folder, *words)
    assert done.returncode == 2
    assert done.stderr.startswith("slamgauge: Windows cannot run user code in isolation")
    assert remedy in done.stderr
    assert done.stderr.count("\n") == 1
