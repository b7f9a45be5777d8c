"""Any name of a user's file or scenario works: imports do not meet it, and pictures, pages and files can show it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.storage.files import save
from slamgauge.compare.storage.safe_names import file_name, shown

pytestmark = pytest.mark.full  # a program start for each name

# our folders, libraries that we import, modules that Python loads early, our test helpers
NAMES = (
    *("ekf", "compare", "graph_baseline", "slam2d", "slamgauge_test", "tests"),
    *("numpy", "scipy", "numba", "gtsam", "tyro", "pydantic", "tqdm", "matplotlib"),
    *("random", "json", "typing", "dataclasses", "pathlib", "socket", "pickle", "queue", "secrets", "utils"),
)
OWN = """
import helper
import numpy
import random
import slamgauge
import utils

def estimate(recording):
    import json  # also inside a function the user's own file is found
    assert helper.NAME == json.NAME == random.NAME == utils.NAME == numpy.NAME == "theirs"
    return slamgauge.Estimate("filtered", slamgauge.chain(recording.prior_mean, recording.odometry))
"""
COMMANDS = pytest.mark.parametrize(
    "command", [[sys.executable, "-m", "slamgauge"], [str(Path(sys.executable).parent / "slamgauge")]], ids=["-m", "it"]
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A student's folder: a recording, and a file with every name that fails when it is imported."""
    folder = tmp_path_factory.mktemp("student")
    for name in NAMES:
        (folder / f"{name}.py").write_text('raise RuntimeError("a user\'s file was imported")\n')
    truth, recording = simulate(load_scenario("q1-short-dense", ["trajectory.duration=2"]), 0)
    save(folder / "recording.npz", recording)
    save(folder / "truth.npz", truth)
    return folder


def rows(command: list[str], folder: Path, *arguments: str) -> dict[str, float]:
    """ATE [m] by estimator."""
    done = subprocess.run([*command, *arguments, "--json"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return {name: entry["ate_m"] for name, entry in json.loads(done.stdout)["estimators"].items()}


@COMMANDS
def test_commands_among_files_with_any_name(command: list[str], folder: Path, tmp_path: Path):
    short = ("--set", "trajectory.duration=2", "--out", str(tmp_path / "out"))
    found = rows(command, folder, "run", "q1-short-dense", *short, "--estimators", "ekf,causal")
    assert {*found} == {"ekf", "causal"}
    study = ("study", "q1-short-dense", *short[:2], "--runs", "2", "--jobs", "2", "--out", str(tmp_path / "study"))
    found = rows(command, folder, *study, "--estimators", "ekf")
    assert found["ekf"]


@COMMANDS
@pytest.mark.parametrize(
    ("own", "label"),
    [
        ("ekf.py:estimate", "ekf.py:estimate"),
        ("ekf:estimate", "ekf:estimate"),
        ("mine=ekf.py:estimate", "mine"),
        ("mine=ekf:estimate", "mine"),
        ("../student/ekf.py:estimate", "ekf.py:estimate"),
    ],
)
def test_an_estimator_with_any_name_among_files_with_any_name(
    command: list[str], folder: Path, tmp_path: Path, own: str, label: str
):
    mine = tmp_path / "student"
    mine.mkdir()
    for name in (*NAMES, "helper"):
        (mine / f"{name}.py").write_text('NAME = "theirs"\n')
    (mine / "ekf.py").write_text(OWN)
    arguments = ("evaluate", str(folder / "recording.npz"), "--estimators", f"dead-reckoning,{own}")
    found = rows(command, mine, *arguments)
    assert found[label] == pytest.approx(found["dead-reckoning"], rel=1e-9)
    assert not list(mine.rglob("__pycache__"))


@COMMANDS
def test_files_on_the_search_path_with_names_of_our_folders(
    command: list[str], folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    for name in ("ekf", "compare", "graph_baseline", "slamgauge_test"):
        (tmp_path / f"{name}.py").write_text("NAME = 1 / 0\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert rows(command, folder, "evaluate", "recording.npz", "--estimators", "ekf")["ekf"]


ODD = (r"cost $\frac$", "bad\udcff", "red\x1b[31m", "<b onclick=alert(1)>&amp;", "n" * 240)
SHORT = 'extends = "q1-long-dense"\n[trajectory]\nduration = 1.0\n'
WRITTEN = {
    "run": (("--estimators", "ekf"), "metrics.json", "figure.svg"),
    "study": (("--runs", "2", "--jobs", "1", "--estimators", "ekf"), "summary.json", "nees.svg"),
    "budget": (("--runs", "2", "--jobs", "1"), "budget.json", "budget.svg"),
}


@pytest.mark.usefixtures("studies_in_a_thread")
@pytest.mark.parametrize(
    ("command", "name"), [*(("run", name) for name in ODD), *((each, ODD[0]) for each in ("study", "budget"))]
)
def test_a_scenario_with_any_name_is_run_and_drawn(
    command: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    scenario, out = tmp_path / f"{name}.toml", tmp_path / "out"
    scenario.write_text(SHORT, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    words, content, picture = WRITTEN[command]
    where = ("--out", str(out))
    if command == "run":  # it names its folder after the scenario
        out, where = tmp_path / "results" / f"{file_name(shown(name))}-seed-0", ()
    assert main([command, scenario.name, *words, *where]) == 0
    assert "\x1b" not in "".join(capsys.readouterr())
    found = json.loads((out / content).read_text(encoding="utf-8"))["scenario"]
    assert found.isprintable()
    ElementTree.parse(out / picture)
