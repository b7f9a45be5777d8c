"""User files that simulate and draw at the level of the module, and what they import that this system lacks."""

from __future__ import annotations

import ast
import textwrap
from pathlib import Path

import numpy as np
import pytest

from slamgauge import load_estimators, load_scenario, simulate
from slamgauge.compare.estimators.needed_code import lines_of, without_simulation
from slamgauge.compare.estimators.stand_ins import OLD_NUMPY, angle_mod, rot_mat_2d
from slamgauge.errors import UserError
from slamgauge.se2 import wrap

pytestmark = pytest.mark.slow

EXAMPLE = Path(__file__).parents[3] / "examples" / "student_ekf.py"
RIGHT = EXAMPLE.read_text(encoding="utf-8")


def left_out(source: str, *wanted: str) -> list[str]:
    """Return the statements that are left out of a module."""
    source = textwrap.dedent(source)
    _, statements = without_simulation(source.encode(), "mine.py", wanted)
    return [ast.unparse(node) for node in statements]


@pytest.mark.parametrize(
    "kept",
    [
        "DT = 0.1",
        "import numpy as np\nQ = np.diag([1.0, 2.0]) ** 2",
        "import numpy as np\nQ = [np.eye(n) for n in range(3)]",
        "known = []\nknown.append(3)\ndef step(x): return x + known[0]",
        "Map = np.zeros((2, 2))\nfor i in range(2):\n    Map[i] = i\ndef step(x): return x + Map",
        "def start():\n    global P\n    P = 1\nstart()\ndef step(x): return x + P",
        "try:\n    import fast\nexcept ImportError:\n    fast = None",
        "import sys\nsys.path.append('..')",
        "def make(): return 3\nestimate = make()",
        "def step(x): return x\nf = lambda x: step(x)",
        "from functools import partial\ndef step(x, noise): return x\nwrapped = partial(step, noise='file')",
        "def make(): return 3\ndef step(x=make()): return x",
        "K = 3\n@decorated(K)\ndef step(x): return x",
    ],
)
def test_what_a_filter_needs_is_kept(kept: str):
    assert not left_out(kept, "estimate")


@pytest.mark.parametrize(
    ("source", "statements"),
    [
        ("def main(): ...\nmain()", ["main()"]),
        ("import matplotlib.pyplot as plt\ndef draw(): plt.plot()\nplt.show()", ["plt.show()"]),
        ("print('hello')\nname = input('your name')\n", ["print('hello')"]),
        ("def step(x): return x\nx = 0\nfor k in range(9):\n    x = step(x)", ["for k in range(9):\n    x = step(x)"]),
        ("def run(): return 3\nhistory = run()\nerror = sum(history)", ["history = run()", "error = sum(history)"]),
        (
            "def main():\n    global x\n    x = 1\nif __name__ == '__main__':\n    main()",
            ["if __name__ == '__main__':\n    main()"],
        ),
    ],
)
def test_what_only_simulates_and_draws_is_left_out(source: str, statements: list[str]):
    assert left_out(source) == statements


def test_the_remark_names_the_lines_and_is_silent_about_guards():
    _, statements = without_simulation(b"x = 1\nprint(x)\n\nfor k in x:\n    pass\n", "mine.py", ())
    assert lines_of(statements) == "code between lines 2 and 5 is not run: it only simulates, draws or prints"
    _, statements = without_simulation(b"if __name__ == '__main__':\n    print()\n", "mine.py", ())
    assert lines_of(statements) == ""


def run_of(path: Path, capfd: pytest.CaptureFixture[str]) -> str:
    """Run a step function, compare it with the unchanged one, and return what was printed."""
    _, recording = simulate(load_scenario("q1-short-dense", ["trajectory.duration=5"]), 1)
    mine = load_estimators([f"mine={path}:ekf_slam"])["mine"](recording)
    right = load_estimators([f"right={EXAMPLE}:ekf_slam"])["right"](recording)
    np.testing.assert_allclose(mine.poses, right.poses, atol=1e-9)
    return capfd.readouterr().err


def test_an_endless_simulation_without_a_guard_is_not_run(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    (tmp_path / "mine.py").write_text(RIGHT + "\nwhile True:\n    print('simulating')\n")
    printed = run_of(tmp_path / "mine.py", capfd)
    assert "simulating" not in printed
    assert "is not run: it only simulates, draws or prints" in printed


def test_missing_drawing_libraries_old_numpy_and_helpers_are_supplied(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    beginning = (
        "import vispy as sns\nfrom cv2 import imshow\nimport pygame.display\nfrom utils.angle import angle_mod\n"
        "from utils.plot import plot_covariance_ellipse\nsns.set_theme(style='dark')\n"
    )
    used = "\nFAR = np.Inf\nWHOLE = np.float(3)\ndef draw():\n    with imshow(1): sns.lineplot()[0].x = np.NaN\n"
    wrapped = RIGHT.replace(
        "def wrap(angle: float) -> float:", "def wrap(angle):\n    return angle_mod(angle)\n\n\ndef unused(angle):"
    )
    assert wrapped != RIGHT
    (tmp_path / "mine.py").write_text(beginning + wrapped + used)
    printed = run_of(tmp_path / "mine.py", capfd)
    for text in (
        "vispy is not installed: what it would draw is left out",
        "cv2 is not installed",
        "pygame is not installed",
        "utils.angle is not found: angle_mod and rot_mat_2d of slamgauge stand in for it",
        "utils.plot is not found",
        "np.Inf, np.NaN, np.float: names of an older numpy are supplied",
    ):
        assert text in printed
    assert not {"Inf", "float"} & {*vars(np)}


def test_another_missing_module_is_an_error_that_names_it(tmp_path: Path):
    (tmp_path / "mine.py").write_text("import no_such_library\n" + RIGHT)
    with pytest.raises(UserError, match="No module named 'no_such_library'"):
        load_estimators([f"mine={tmp_path / 'mine.py'}:ekf_slam"])


def test_helpers_agree_with_their_definition():
    angles = np.array([-7.0, -np.pi, 0.1, np.pi, 4.0, 9.0])
    np.testing.assert_allclose(np.cos(angle_mod(angles)), np.cos(angles), atol=1e-12)
    assert (np.abs(angle_mod(angles)) <= np.pi).all()
    assert isinstance(angle_mod(4.0), float)
    assert angle_mod(4.0) == pytest.approx(float(wrap(4.0)))
    assert angle_mod(-10.0, zero_2_2pi=True, degree=True) == pytest.approx(350.0)
    np.testing.assert_allclose(rot_mat_2d(0.3) @ [1.0, 0.0], [np.cos(0.3), np.sin(0.3)])
    assert not {*OLD_NUMPY} & {"array", "zeros"}
