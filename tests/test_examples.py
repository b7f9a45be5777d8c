"""Each example runs as its docstring says, and prints and saves the expected results."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from slamgauge.compare.cli.main import main
from slamgauge.compare.storage.files import load_recording, save
from slamgauge.graph_baseline import batch
from slamgauge.recording import Recording
from tests.kernels import compile_kernels
from tests.reference.random_recordings import random_recording

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture(scope="module", autouse=True)
def compiled_kernels() -> None:
    """Compile all kernels, because the first compilation prints a message on standard error."""
    compile_kernels()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy the examples to a temporary folder."""
    there = tmp_path_factory.mktemp("copy") / "examples"
    return shutil.copytree(EXAMPLES, there, ignore=shutil.ignore_patterns("__pycache__", "results"))


def run(folder: Path, *arguments: str, status: int = 0) -> tuple[str, str]:
    """Run Python in the folder and return standard output and standard error."""
    done = subprocess.run([sys.executable, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, "Traceback" in done.stderr) == (status, False), done.stderr
    return done.stdout, done.stderr


def rows(text: str) -> dict[str, dict[str, str]]:
    """Return the cells of each estimator in a printed table by column title, without the notes below the table."""
    titles, *lines = (re.split(r"\s{2,}", line.strip()) for line in text.strip().splitlines())
    lines = [line for line in lines if len(line) > 1]
    return {line[0]: dict(zip(titles, line, strict=True)) for line in lines}


@pytest.mark.gtsam
def test_exercise(folder: Path):
    """On these ten runs GTSAM batch, which also uses later measurements, has the smaller error."""
    printed, errors = run(folder, "exercise.py", "q1-short-dense")
    assert errors == ""
    rms = dict(re.findall(r"^(ekf|gtsam-batch) +RMS position error (\S+) m, NEES/3 \S+ ", printed, re.MULTILINE))
    assert 0.1 < float(rms["gtsam-batch"]) < float(rms["ekf"]) < 0.3
    assert (folder / "exercise.png").stat().st_size > 0


def test_fej2_ekf(folder: Path):
    run(folder, "fej2_ekf.py", "0.1", "close.toml")
    estimators = "ekf,projected=fej2_ekf.py:projected,inflated=fej2_ekf.py:inflated"
    words = ("run", "close.toml", "--set", "trajectory.duration=2", "--estimators", estimators, "--out", "close")
    printed, _ = run(folder, "-m", "slamgauge", *words)
    assert list(rows(printed)) == ["ekf", "projected", "inflated"]


def test_own_estimator(folder: Path):
    """On one fixed run the naive filter is worse than the optimum and very overconfident."""
    printed, errors = run(folder, "own_estimator.py")
    table = rows(printed)
    assert (errors, list(table)) == ("", ["own", "causal", "batch"])
    assert 1.2 < float(table["own"]["x optimum"]) < 3.0
    assert float(table["own"]["NEES"]) > 30.0
    assert 0.0 < float(table["causal"]["NEES"]) < 5.0


def test_own_estimator_refuses_other_sensors(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    save(tmp_path / "recording.npz", random_recording(0, sensor="position", steps=5)[1])
    monkeypatch.chdir(folder)
    arguments = ("--estimators", "own_estimator:estimate", "--out", str(tmp_path / "out"))
    assert main(["evaluate", str(tmp_path / "recording.npz"), *arguments]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert "this filter needs known association, ranges and bearings (own_estimator.py, line " in line


@pytest.fixture(scope="module")
def imported(folder: Path) -> Recording:
    """Write the log of the example robot and import it."""
    run(folder, "robot_log.py", "my-log")
    assert main(["import", "csv", str(folder / "my-log"), "--out", str(folder / "mine")]) == 0
    return load_recording(folder / "mine/recording.npz")


def test_robot_log(imported: Recording):
    """The stated noise is that of the log: chi-square is in its two-sided 99.9 % band."""
    estimate = batch(imported)
    assert estimate.chi_square is not None
    assert estimate.chi_square_dof is not None
    low, high = chi2.ppf([0.0005, 0.9995], estimate.chi_square_dof)
    assert low < estimate.chi_square < high


def test_robot_loop(folder: Path, imported: Recording):
    out, err = run(folder, "robot_loop.py", "mine/recording.npz")
    assert err == ""
    optimum = batch(imported)
    assert optimum.pose_covs is not None
    pose = [float(number) for number in re.findall(r"(\S+) (?:m|rad)\b", out.splitlines()[0])]
    assert np.all(np.abs(pose - optimum.poses[-1]) < np.sqrt(np.diag(optimum.pose_covs[-1])))
    assert re.search(r"^map     13 landmarks; \d of 3144 observations rejected$", out, flags=re.MULTILINE)
