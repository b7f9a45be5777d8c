"""Commands run among files with any name, with scenarios of any name, and without the things that Windows lacks."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from textwrap import indent
from xml.etree import ElementTree

import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.storage.files import save
from slamgauge.compare.storage.result_files import file_name, shown

pytestmark = [pytest.mark.full, pytest.mark.slow]  # several programs, and a run for each name

# our folders, libraries that we import, modules that Python loads early, our test helpers
NAMES = (
    *("ekf", "compare", "graph_baseline", "slam2d", "slamgauge_test", "tests"),
    *("numpy", "scipy", "numba", "gtsam", "tyro", "pydantic", "tqdm", "matplotlib"),
    *("random", "json", "typing", "dataclasses", "pathlib", "socket", "pickle", "queue", "secrets", "utils"),
)
OWN = """
import helper
import slamgauge
import utils

def estimate(recording):
    assert helper.NAME == utils.NAME == "theirs"
    return slamgauge.Estimate("filtered", slamgauge.chain(recording.prior_mean, recording.odometry))
"""


@pytest.mark.parametrize(
    "command", [[sys.executable, "-m", "slamgauge"], [str(Path(sys.executable).parent / "slamgauge")]], ids=["-m", "it"]
)
def test_commands_among_files_with_any_name(command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Commands import none of the user's files, and the user's own code finds them, by file or by module."""
    mine, path = tmp_path / "student", tmp_path / "path"
    mine.mkdir()
    path.mkdir()
    for name in ("ekf", "compare", "graph_baseline", "slamgauge_test"):
        (path / f"{name}.py").write_text("NAME = 1 / 0\n")
    monkeypatch.setenv("PYTHONPATH", str(path))
    truth, recording = simulate(load_scenario("q1-short-dense", ["trajectory.duration=2"]), 0)
    save(mine / "recording.npz", recording)
    save(mine / "truth.npz", truth)
    study = ("study", "q1-short-dense", "--set", "trajectory.duration=2", "--runs", "2", "--jobs", "2")
    for content, words in {
        "raise RuntimeError": (*study, "--estimators", "dead-reckoning,ekf", "--out", "study"),
        'NAME = "theirs"': ("evaluate", "recording.npz", "--estimators", "ekf.py:estimate,mine=ekf:estimate"),
    }.items():
        for name in (*NAMES, "helper"):
            (mine / f"{name}.py").write_text(OWN if name == "ekf" and "NAME" in content else content)
        done = subprocess.run([*command, *words, "--json"], cwd=mine, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    assert not list(mine.rglob("__pycache__"))


@pytest.mark.parametrize("name", [r"cost $\frac$", "bad\udcff", "red\x1b[31m", "<b onclick=alert(1)>&amp;", "n" * 240])
def test_a_scenario_with_any_name_is_run_and_drawn(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    scenario = tmp_path / f"{name}.toml"
    scenario.write_text('extends = "q1-long-dense"\n[trajectory]\nduration = 1.0\n', encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "results" / f"{file_name(shown(name))}-seed-0"
    assert main(["run", scenario.name, "--estimators", "ekf"]) == 0
    assert "\x1b" not in "".join(capsys.readouterr())
    assert json.loads((out / "metrics.json").read_text(encoding="utf-8"))["scenario"].isprintable()
    ElementTree.parse(out / "figure.svg")


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


def test_the_main_commands_run_like_on_windows(tmp_path: Path):
    """In one process, one after the other, without `fcntl`, `resource`, `pwd` and GTSAM."""
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
