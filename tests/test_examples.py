"""Examples print and save the expected results; those of README and the pages run in `test_commands_of_pages`."""

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
from slamgauge.compare.storage.files import load_recording
from slamgauge.graph_baseline import batch
from tests.kernels import compile_kernels

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the examples; kernels are compiled, because the first compilation prints a message."""
    compile_kernels()
    return shutil.copytree(Path(__file__).parents[1] / "examples", tmp_path_factory.mktemp("copy") / "examples")


def run(folder: Path, *arguments: str) -> str:
    """Run Python in the folder, without notices, and return standard output."""
    done = subprocess.run([sys.executable, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


@pytest.mark.gtsam
def test_exercise(folder: Path):
    """On these ten runs GTSAM batch, which also uses later measurements, has the smaller error."""
    printed = run(folder, "exercise.py", "q1-short-dense")
    rms = dict(re.findall(r"^(ekf|gtsam-batch) +RMS position error (\S+) m, NEES/3 \S+ ", printed, re.MULTILINE))
    assert 0.1 < float(rms["gtsam-batch"]) < float(rms["ekf"]) < 0.3
    assert (folder / "exercise.png").stat().st_size > 0


def test_own_estimator(folder: Path):
    """On one fixed run the naive filter is worse than the optimum and very overconfident."""
    lines = [re.split(r"\s{2,}", line.strip()) for line in run(folder, "own_estimator.py").splitlines()[:4]]
    table = {name: dict(zip(lines[0][1:], cells, strict=True)) for name, *cells in lines[1:]}
    assert 1.2 < float(table["own"]["x optimum"]) < 3.0
    assert float(table["own"]["NEES"]) > 30.0


def test_robot_log_and_loop(folder: Path):
    """The stated noise is that of the log: chi-square is in its two-sided 99.9 % band; the loop ends at the optimum."""
    run(folder, "robot_log.py", "my-log")
    assert main(["import", "csv", str(folder / "my-log"), "--out", str(folder / "mine")]) == 0
    optimum = batch(load_recording(folder / "mine/recording.npz"))
    assert optimum.chi_square is not None and optimum.chi_square_dof is not None and optimum.pose_covs is not None
    low, high = chi2.ppf([0.0005, 0.9995], optimum.chi_square_dof)
    assert low < optimum.chi_square < high
    out = run(folder, "robot_loop.py", "mine/recording.npz")
    pose = [float(number) for number in re.findall(r"(\S+) (?:m|rad)\b", out.splitlines()[0])]
    assert np.all(np.abs(pose - optimum.poses[-1]) < np.sqrt(np.diag(optimum.pose_covs[-1])))
    assert re.search(r"^map     13 landmarks; \d of 3144 observations rejected$", out, flags=re.MULTILINE)
