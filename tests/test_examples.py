"""Each example runs as its docstring says, and prints and saves the expected results."""

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

from slamgauge.compare.cli.main import main
from slamgauge.compare.storage.files import load_recording, save
from slamgauge.graph_baseline import batch
from slamgauge.recording import Recording
from tests.kernels import compile_kernels
from tests.reference.random_recordings import random_recording

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


@pytest.fixture(scope="module")
def own_table(folder: Path) -> dict[str, dict[str, str]]:
    """Run the example, and return the table that it prints."""
    printed, errors = run(folder, "own_estimator.py")
    assert errors == ""
    return rows(printed)


def test_own_estimator(own_table: dict[str, dict[str, str]]):
    """On one fixed run the naive filter is worse than the optimum and very overconfident."""
    assert list(own_table) == ["own", "causal", "batch"]
    assert 1.2 < float(own_table["own"]["x optimum"]) < 3.0
    assert float(own_table["own"]["NEES"]) > 30.0
    assert 0.0 < float(own_table["causal"]["NEES"]) < 5.0


def test_own_estimator_in_evaluate(folder: Path, own_table: dict[str, dict[str, str]]):
    """`evaluate` prints the same figures; the naive filter follows the robot."""
    run(folder, "-m", "slamgauge", "run", "q1-long-dense", "--estimators", "dead-reckoning", "--out", "first-run")
    arguments = ("--estimators", "dead-reckoning,riekf,own_estimator:estimate")
    printed, _ = run(folder, "-m", "slamgauge", "evaluate", "first-run/recording.npz", *arguments)
    again = rows(printed)
    assert list(again) == ["dead-reckoning", "riekf", "own_estimator:estimate"]
    own = again["own_estimator:estimate"]
    columns = ("kind", "ATE [m]", "NEES", "in 95% ellipse")
    assert [own[column] for column in columns] == [own_table["own"][column] for column in columns]
    assert float(again["riekf"]["ATE [m]"]) < float(own["ATE [m]"]) < float(again["dead-reckoning"]["ATE [m]"]) / 5


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


def compared(folder: Path, question: int, shape: tuple[int, int, int]) -> dict[str, str]:
    """Run the example for a question, check the size of its figure, and return the printed table per scenario."""
    printed, errors = run(folder, "compare_questions.py", str(question), "--out", "my results")
    assert all(" estimators, " in line for line in errors.splitlines())  # progress of an estimator that takes long
    *texts, last = printed.split("\n\n")
    assert last == "figure: my results/figure.png\n"
    assert imread(folder / "my results/figure.png").shape == shape
    titles = [text.partition("\n")[0].split(", seed 0") for text in texts]
    assert [end for _, end in titles] == [""] * len(texts)
    return {name: text.partition("\n")[2] for (name, _), text in zip(titles, texts, strict=True)}


def test_compare_question_1(folder: Path):
    tables = {name: rows(text) for name, text in compared(folder, 1, (1050, 2250, 4)).items()}
    assert list(tables) == ["q1-short-dense", "q1-long-dense", "q1-long-sparse"]
    for scenario, table in tables.items():
        assert list(table) == ["dead-reckoning", "ekf", "riekf", "causal", "batch"]
        assert float(table["causal"]["x optimum"]) == float(table["batch"]["x optimum"]) == 1.0
        assert 0.95 < float(table["ekf"]["NIS/dof"]) < 1.05
        assert float(table["dead-reckoning"]["x optimum"]) > (2.0 if scenario == "q1-long-sparse" else 5.0)
        distance = "Mahalanobis distance² to the optimum"
        assert float(table["riekf"][distance]) < float(table["ekf"][distance])

    picture = imread(folder / "my results/figure.png")[:, :, :3]
    saturation = picture.max(axis=2) - picture.min(axis=2)
    for third in np.split(saturation, 3, axis=1):
        assert (third > 0.3).sum() > 2000  # coloured paths in each of the three maps


def test_compare_question_2(folder: Path):
    """On one fixed run the gates map too many landmarks, a few duplicates, and too few or wrong ones."""
    tables = {name: rows(text) for name, text in compared(folder, 2, (1050, 2250, 4)).items()}
    assert list(tables) == ["q2-gate-1", "q2-long-dense", "q2-gate-100"]
    narrow, right, wide = tables.values()
    names = ["ekf", "riekf", "causal", "causal@ekf"]
    assert [list(table) for table in tables.values()] == [names[:3], names, names]
    assert int(narrow["ekf"]["mapped landmarks"]) > 20 * 37
    assert 37 < int(right["ekf"]["mapped landmarks"]) < 5 * 37
    for table in tables.values():
        assert (table["causal"]["mapped landmarks"], table["causal"]["wrong associations"]) == ("37", "0")
        assert float(table["causal"]["x optimum"]) == 1.0
    for table in (right, wide):
        assert table["causal@ekf"]["wrong associations"] == table["ekf"]["wrong associations"]
    assert float(wide["ekf"]["ATE [m]"]) > 2 * float(right["ekf"]["ATE [m]"])


def test_compare_question_3(folder: Path):
    """On one fixed run the NEES decreases with the assumed noise, and the optimum has the true noise."""
    tables = {name: rows(text) for name, text in compared(folder, 3, (750, 2250, 4)).items()}
    assert list(tables) == ["q3-scale-0.1", "q3-scale-1", "q3-scale-2", "q3-scale-10"]
    assert len({table["causal"]["ATE [m]"] for table in tables.values()}) == 1
    for name in ("ekf", "riekf"):
        nees = [float(table[name]["NEES"]) for table in tables.values()]
        mapped = [int(table[name]["mapped landmarks"]) for table in tables.values()]
        assert nees[0] > 10 * nees[1] > 10 * nees[3]
        assert mapped[0] > 10 * mapped[3]


def test_compare_question_4(folder: Path):
    """On one fixed run every initialisation maps all landmarks, and every filter ends near the optimum."""
    texts = compared(folder, 4, (1050, 2250, 4))
    assert list(texts) == ["q4-three-landmarks", "q4-ring"]
    ways = ["ekf, fis", "riekf, fis", "riekf, inverse-depth", "riekf, delayed"]
    for text, landmarks in zip(texts.values(), ("3", "19"), strict=True):
        lines = [line for line in text.splitlines()[1:] if "  " in line]
        assert [line.partition("  ")[0] for line in lines] == [*ways, "causal"]
        for line in lines:
            assert {cell.strip() for cell in line.split("  ")} >= {landmarks, "0"}  # mapped, and none wrong
            assert float(line[line.index("filtered") + 8 :].split()[0]) < 2.0  # ATE [m]


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
