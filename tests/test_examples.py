"""The examples: each runs as its docstring says, and what it prints and saves shows what it promises."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from scipy.stats import chi2

from slamgauge.compare.storage.files import load_recording
from slamgauge.ekf.kernels.warm_up import compile_association_once, compile_bearings_once, compile_once
from slamgauge.graph_baseline import batch
from slamgauge.graph_baseline.solver.warm_up import compile_graphs_once

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture(scope="module", autouse=True)
def compiled_kernels() -> None:
    """Where they are compiled for the first time, that is announced on standard error."""
    compile_once()
    compile_association_once()
    compile_bearings_once()
    compile_graphs_once()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The examples, somewhere else."""
    return shutil.copytree(EXAMPLES, tmp_path / "examples", ignore=shutil.ignore_patterns("__pycache__", "results"))


def run(folder: Path, *arguments: str, status: int = 0) -> tuple[str, str]:
    """What Python, started in the folder, prints on standard output and on standard error."""
    done = subprocess.run([sys.executable, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, "Traceback" in done.stderr) == (status, False), done.stderr
    return done.stdout, done.stderr


def rows(text: str) -> dict[str, dict[str, str]]:
    """A printed table: the cells of each estimator by the titles of their columns; the notes under it left out."""
    titles, *lines = (re.split(r"\s{2,}", line.strip()) for line in text.strip().splitlines())
    lines = [line for line in lines if len(line) > 1]
    return {line[0]: dict(zip(titles, line, strict=True)) for line in lines}


def test_own_estimator(folder: Path):
    """On one fixed run the naive filter is worse than the optimum and far too sure of itself, but follows the robot."""
    printed, errors = run(folder, "own_estimator.py")
    assert errors == ""
    table = rows(printed)
    assert list(table) == ["own", "causal", "batch"]
    assert 1.2 < float(table["own"]["x optimum"]) < 3.0
    assert float(table["own"]["NEES"]) > 30.0
    assert 0.0 < float(table["causal"]["NEES"]) < 5.0

    run(folder, "-m", "slamgauge", "run", "q1-long-dense", "--estimators", "dead-reckoning", "--out", "first-run")
    arguments = ("--estimators", "dead-reckoning,riekf,own_estimator:estimate")
    printed, _ = run(folder, "-m", "slamgauge", "evaluate", "first-run/recording.npz", *arguments)
    again = rows(printed)
    assert list(again) == ["dead-reckoning", "riekf", "own_estimator:estimate"]
    own = again["own_estimator:estimate"]
    columns = ("kind", "ATE [m]", "NEES", "in 95% ellipse")
    assert [own[column] for column in columns] == [table["own"][column] for column in columns]
    assert float(again["riekf"]["ATE [m]"]) < float(own["ATE [m]"]) < float(again["dead-reckoning"]["ATE [m]"]) / 5


def test_own_estimator_refuses_what_it_does_not_know(folder: Path):
    overrides = ["sensor.kind='position'", "sensor.sigma_position=0.1", "trajectory.duration=2"]
    path = folder / "positions.toml"
    shipped = EXAMPLES.parent / "compare/scenarios/q1-short-dense.toml"
    lines = shipped.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(line for line in lines if not line.startswith(("sigma_range", "sigma_bearing"))))
    simulated = ("run", "positions.toml", "--estimators", "dead-reckoning", "--out", "run", "--set", *overrides)
    run(folder, "-m", "slamgauge", *simulated)
    own = ("--estimators", "own_estimator:estimate")
    printed, errors = run(folder, "-m", "slamgauge", "evaluate", "run/recording.npz", *own, status=2)
    assert printed == ""
    (line,) = errors.splitlines()
    assert "this filter needs known association, ranges and bearings (own_estimator.py, line " in line


def test_compare_question_1(folder: Path):
    printed, errors = run(folder, "compare_question_1.py", "--out", "maps of mine")
    assert errors == ""
    short, dense, sparse, last = printed.split("\n\n")
    for text, scenario in ((short, "q1-short-dense"), (dense, "q1-long-dense"), (sparse, "q1-long-sparse")):
        title, _, body = text.partition("\n")
        assert title == f"{scenario}, seed 0"
        table = rows(body)
        assert list(table) == ["dead-reckoning", "ekf", "riekf", "causal", "batch"]
        assert float(table["causal"]["x optimum"]) == float(table["batch"]["x optimum"]) == 1.0
        assert 0.95 < float(table["ekf"]["NIS/dof"]) < 1.05
        assert float(table["dead-reckoning"]["x optimum"]) > (2.0 if scenario == "q1-long-sparse" else 5.0)
        assert float(table["riekf"]["Mahalanobis distance² to the optimum"]) < float(
            table["ekf"]["Mahalanobis distance² to the optimum"]
        )
    assert last == "maps: maps of mine/maps.png\n"

    picture = imread(folder / "maps of mine/maps.png")[:, :, :3]
    assert picture.shape == (1050, 2250, 3)
    saturation = picture.max(axis=2) - picture.min(axis=2)
    for third in np.split(saturation, 3, axis=1):
        assert (third > 0.3).sum() > 2000  # coloured paths in each of the three maps


def test_compare_question_2(folder: Path):
    """On one fixed run the gates map too many landmarks, a few doubles, and too few or wrong ones."""
    printed, errors = run(folder, "compare_question_2.py", "--out", "maps of mine")
    assert errors == ""
    *texts, last = printed.split("\n\n")
    tables = [rows(text.partition("\n")[2]) for text in texts]
    assert [text.partition(",")[0] for text in texts] == ["q2-gate-1", "q2-long-dense", "q2-gate-100"]
    names = ["ekf", "riekf", "causal", "causal@ekf"]
    assert [list(table) for table in tables] == [names[:3], names, names]
    mapped = [int(table["ekf"]["mapped landmarks"]) for table in tables]
    assert mapped[0] > 20 * 37
    assert 37 < mapped[1] < 5 * 37
    for table in tables:
        assert (table["causal"]["mapped landmarks"], table["causal"]["wrong associations"]) == ("37", "0")
        assert float(table["causal"]["x optimum"]) == 1.0
    for table in tables[1:]:
        assert table["causal@ekf"]["wrong associations"] == table["ekf"]["wrong associations"]
    assert float(tables[2]["ekf"]["ATE [m]"]) > 2 * float(tables[1]["ekf"]["ATE [m]"])
    assert last == "maps: maps of mine/maps.png\n"
    assert imread(folder / "maps of mine/maps.png").shape == (1050, 2250, 4)


def test_compare_question_3(folder: Path):
    """On one fixed run the reported NEES falls with the assumed noise, and the optimum knows the true one."""
    printed, errors = run(folder, "compare_question_3.py", "--out", "errors of mine")
    assert errors == ""
    *texts, last = printed.split("\n\n")
    tables = [rows(text.partition("\n")[2]) for text in texts]
    scales = ["q3-scale-0.1", "q3-scale-1", "q3-scale-2", "q3-scale-10"]
    assert [text.partition(",")[0] for text in texts] == scales
    assert len({table["causal"]["ATE [m]"] for table in tables}) == 1
    for name in ("ekf", "riekf"):
        nees = [float(table[name]["NEES"]) for table in tables]
        assert nees[0] > 10 * nees[1] > 10 * nees[3]
        assert int(tables[0][name]["mapped landmarks"]) > 10 * int(tables[3][name]["mapped landmarks"])
    assert last == "errors: errors of mine/errors.png\n"
    assert imread(folder / "errors of mine/errors.png").shape == (600, 1800, 4)


def test_compare_question_4(folder: Path):
    """On one fixed run every way to begin a landmark maps all of them, and ends near the optimum."""
    printed, errors = run(folder, "compare_question_4.py", "--out", "maps of mine")
    assert errors == ""
    *texts, last = printed.split("\n\n")
    assert [text.partition(",")[0] for text in texts] == ["q4-three-landmarks", "q4-ring"]
    ways = ["ekf, fis", "riekf, fis", "riekf, inverse-depth", "riekf, delayed"]
    for text, landmarks in zip(texts, ("3", "19"), strict=True):
        lines = [line for line in text.splitlines()[2:] if "  " in line]
        assert [line.partition("  ")[0] for line in lines] == [*ways, "causal"]
        for line in lines:
            cells = line.split("  ")
            assert {cell.strip() for cell in cells} >= {landmarks, "0"}  # mapped, and none wrong
            assert float(line[line.index("filtered") + 8 :].split()[0]) < 2.0  # ATE [m]
    assert last == "maps: maps of mine/maps.png\n"
    assert imread(folder / "maps of mine/maps.png").shape == (1050, 1800, 4)


def test_robot_log(folder: Path):
    """A robot's log is brought in, and its true noise fits it: chi-square in its band of 99.9 %, both sides."""
    run(folder, "robot_log.py", "my-log")
    run(folder, "-m", "slamgauge", "import", "csv", "my-log", "--out", "mine")
    estimate = batch(load_recording(folder / "mine/recording.npz"))
    assert estimate.chi_square is not None
    assert estimate.chi_square_dof is not None
    low, high = chi2.ppf([0.0005, 0.9995], estimate.chi_square_dof)
    assert low < estimate.chi_square < high


def test_robot_loop(folder: Path):
    run(folder, "robot_log.py", "my-log")
    run(folder, "-m", "slamgauge", "import", "csv", "my-log", "--out", "mine")
    out, err = run(folder, "robot_loop.py", "mine/recording.npz")
    assert err == ""
    optimum = batch(load_recording(folder / "mine" / "recording.npz"))
    assert optimum.pose_covs is not None
    pose = [float(number) for number in re.findall(r"(\S+) (?:m|rad)\b", out.splitlines()[0])]
    assert np.all(np.abs(pose - optimum.poses[-1]) < np.sqrt(np.diag(optimum.pose_covs[-1])))
    assert re.search(r"^map     13 landmarks; \d of 3144 observations left out$", out, flags=re.MULTILINE)
