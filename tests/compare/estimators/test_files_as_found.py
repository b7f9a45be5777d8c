"""Files as they are found: helpers in folders above, drawing in every step, old numpy names in threads."""

from __future__ import annotations

import ast
import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

from slamgauge import Estimate, load_scenario, simulate
from slamgauge.compare.estimators.adapters import adapted
from slamgauge.compare.estimators.isolated_process import Isolated
from slamgauge.compare.estimators.needed_code import without_simulation
from slamgauge.compare.estimators.stand_ins import old_numpy_names, stand_in, supplied
from slamgauge.compare.estimators.user_code import address

pytestmark = pytest.mark.slow

_, RECORDING = simulate(load_scenario("q1-short-dense", ["trajectory.duration=1"]), 0)
STEPS = RECORDING.steps + 1

HELPER = """
from utils_of_lab.angle import offset
from slamgauge import Estimate
import numpy as np

def estimate(recording):
    return Estimate("filtered", np.full((len(recording.odometry) + 1, 3), offset(1.0)))
"""
APPENDED = """
import sys, pathlib
sys.path.append(str(pathlib.Path(__file__).parent.parent / "library"))
"""


def estimates(path: Path) -> list[Estimate]:
    """Return the estimates of a file in this process, then isolated."""
    where = address(f"mine={path}:estimate")
    isolated = Isolated(where, 60.0)
    try:
        return [adapted(where)[0](RECORDING), isolated(RECORDING)]
    finally:
        isolated.close()


def package(folder: Path, value: float) -> None:
    (folder / "utils_of_lab").mkdir(parents=True)
    (folder / "utils_of_lab/__init__.py").write_text("")
    (folder / "utils_of_lab/angle.py").write_text(f"def offset(x):\n    return x + {value}\n")


def lay(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.mark.parametrize(("head", "place"), [("", ""), (APPENDED, "SLAM/library")])
def test_helpers_are_found_above_and_where_the_file_adds_to_the_path(tmp_path: Path, head: str, place: str):
    package(tmp_path / place, 2.0)
    path = lay(tmp_path / "SLAM/EKFSLAM/mine.py", head + HELPER)
    before = [*sys.path]
    for estimate in estimates(path):
        np.testing.assert_array_equal(estimate.poses, np.full((STEPS, 3), 3.0))
    assert sys.path == before
    assert "utils_of_lab" not in sys.modules
    assert f"utils_of_lab is loaded from {tmp_path / place}" in adapted(address(f"{path}:estimate"))[1]


def test_the_nearest_helper_counts_and_the_fifth_folder_above_does_not(tmp_path: Path):
    package(tmp_path, 9.0)
    path = lay(tmp_path / "a/b/c/d/e/mine.py", HELPER)
    with pytest.raises(ValueError, match=r"No module named 'utils_of_lab' \(mine.py, line 2\)"):
        adapted(address(f"{path}:estimate"))
    package(tmp_path / "a", 5.0)
    package(tmp_path / "a/b/c", 4.0)
    assert adapted(address(f"{path}:estimate"))[0](RECORDING).poses[0, 0] == 5.0


def test_helpers_above_count_in_the_digest_and_travel_to_workers(tmp_path: Path):
    package(tmp_path, 2.0)
    path = lay(tmp_path / "SLAM/EKFSLAM/mine.py", HELPER)
    sources = address(f"{path}:estimate").sources
    assert sources is not None
    elsewhere = dataclasses.replace(sources, folder=str(tmp_path / "missing")).place()
    assert (elsewhere / "mine.py").read_text() == HELPER
    assert (elsewhere / "../../utils_of_lab/angle.py").read_text() == "def offset(x):\n    return x + 2.0\n"
    (tmp_path / "utils_of_lab/angle.py").write_text("def offset(x):\n    return x\n")
    changed = address(f"{path}:estimate").sources
    assert changed is not None
    assert changed.digest != sources.digest


DRAWS = """
import matplotlib.pyplot as plt
import numpy as np
from slamgauge import Estimate

def estimate(recording):
    for _ in range(3):
        plt.plot([1, 2])
        plt.pause(1000.0)
    plt.show()
    plt.ginput(1, timeout=1000.0)
    return Estimate("filtered", np.full((len(recording.odometry) + 1, 3), float(plt.get_backend().lower() == "agg")))
"""


def test_drawing_in_a_run_neither_opens_windows_nor_waits(tmp_path: Path):
    for estimate in estimates(lay(tmp_path / "mine.py", DRAWS)):
        assert estimate.poses[0, 0] == 1.0
    pyplot = sys.modules["matplotlib.pyplot"]
    assert pyplot.get_fignums() == []
    assert "no_windows" not in pyplot.pause.__module__


def test_a_removed_name_stays_until_the_last_user_leaves():
    first, second = supplied(["NINF"]), supplied(["NINF"])
    with first:
        second.__enter__()
    assert vars(np)["NINF"] == -np.inf
    second.__exit__(None, None, None)
    assert "NINF" not in vars(np)


@pytest.mark.parametrize("source", ["import numpy as np\nx = np.NINF", "from numpy import NINF, zeros"])
def test_old_names_are_found_in_both_forms_of_import(source: str):
    assert old_numpy_names(ast.parse(source)) == ["NINF"]


def test_a_missing_library_leaves_loops_decorated_functions_and_classes_alone():
    progress, game = stand_in("tqdm"), stand_in("pygame")
    assert progress is not None
    assert game is not None
    assert [*progress[0].tqdm(range(3), desc="steps")] == [0, 1, 2]
    assert game[0].decorator(estimates) is estimates
    space = {"pygame": game[0]}
    exec("class Robot(pygame.sprite.Sprite):\n    speed = 2.0\n", space)
    assert getattr(space["Robot"], "speed", None) == 2.0
    assert [*game[0].event.get()] == []
    assert stand_in("pandas") is None


def test_a_call_of_numpy_that_changes_a_needed_matrix_is_kept():
    matrix = "import numpy as np\nQ = np.zeros((2, 2))\nnp.fill_diagonal(Q, 0.1)\nnp.save('a', 1)\n"
    _, left_out = without_simulation(f"{matrix}def f(x):\n    return Q\n".encode(), "mine.py", ())
    assert [node.lineno for node in left_out] == [4]
