"""No name of a user's file meets an import of ours, and their own imports find their own files."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.storage.files import save

# names of our folders, of libraries that we import, of modules that Python loads early, of our test helpers
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
    import json  # inside a function, too, theirs is the neighbour
    assert helper.NAME == json.NAME == random.NAME == utils.NAME == numpy.NAME == "theirs"
    return slamgauge.Estimate("filtered", slamgauge.chain(recording.prior_mean, recording.odometry))
"""
COMMANDS = pytest.mark.parametrize(
    "command", [[sys.executable, "-m", "slamgauge"], [str(Path(sys.executable).parent / "slamgauge")]], ids=["-m", "it"]
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A student's folder: nonsense under every name, beside a recording."""
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
def test_commands_among_files_of_any_name(command: list[str], folder: Path, tmp_path: Path):
    short = ("--set", "trajectory.duration=2", "--out", str(tmp_path / "out"))
    assert set(rows(command, folder, "run", "q1-short-dense", *short, "--estimators", "ekf,causal")) == {
        "ekf",
        "causal",
    }
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
def test_an_estimator_of_any_name_with_neighbours_of_any_name(
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
def test_files_on_the_search_path_that_nobody_else_needs(
    command: list[str], folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    for name in ("ekf", "compare", "graph_baseline", "slam2d", "slamgauge_test"):
        (tmp_path / f"{name}.py").write_text("NAME = 1 / 0\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert rows(command, folder, "evaluate", "recording.npz", "--estimators", "ekf")["ekf"]
