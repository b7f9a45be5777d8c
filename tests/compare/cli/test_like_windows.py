"""The main commands run without `fcntl`, `resource`, `pwd`, GTSAM and the other things that Windows lacks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from textwrap import indent

import pytest

pytestmark = pytest.mark.slow

BLOCKED = Path(__file__).parents[2] / "like_windows"
SHORT = ["--set", "trajectory.duration=5"]
COMMANDS = [
    ["scenarios"],
    ["run", "q1-short-dense", *SHORT, "--estimators", "ekf,causal,batch", "--out", "run"],
    ["evaluate", "run/recording.npz", "--truth", "run/truth.npz", "--estimators", "ekf,mine.py:estimate"],
    ["study", "q1-short-dense", *SHORT, "--runs", "3", "--jobs", "2", "--estimators", "ekf", "--out", "study"],
    ["check", "mine.py:estimate"],
    ["noise", "run/recording.npz", "--out", "noise"],
    ["export", "csv", "run", "--out", "log"],
    ["import", "csv", "log", "--out", "imported"],
    ["bench", "--landmarks", "5", "--estimators", "ekf"],
    ["doctor"],
]
MINE = "import slamgauge\n\n\ndef estimate(recording):\n    return slamgauge.ekf_slam(recording)\n"


@pytest.mark.full  # most commands, one after the other, without fcntl
def test_the_main_commands_run(tmp_path: Path):
    """In one process, one after the other."""
    program = (
        "import sys\n"
        "from slamgauge.compare.cli.main import main\n"
        "assert sys.modules['fcntl'] is sys.modules['gtsam'] is None\n"
        f"for words in {COMMANDS}:\n"
        "    assert main(words) == 0, words\n"
    )
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "commands.py").write_text(f"if __name__ == '__main__':\n{indent(program, '    ')}")  # for `study`
    done = subprocess.run(
        [sys.executable, "commands.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(BLOCKED), "PYTHONWARNINGS": "ignore"},  # filelock warns on Linux alone
        check=False,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
