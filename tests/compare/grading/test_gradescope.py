"""`results.json` for Gradescope, and the autograder of examples/gradescope with local paths."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
STUDENT = ROOT / "examples/student_ekf.py"
SCENARIO = 'extends = "q1-short-dense"\n\n[trajectory]\nduration = 6.0\n'
KEYS = {"score", "max_score", "execution_time", "output", "output_format", "visibility", "stdout_visibility"}


def autograded(folder: Path, files: dict[str, str], rubric: str = "") -> tuple[dict[str, Any], str]:
    """Run the autograder on a submission; return results.json and what it printed."""
    for name in ("source", "submission"):
        (folder / name).mkdir()
    for name, content in files.items():
        (folder / "submission" / name).write_text(content)
    (folder / "short.toml").write_text(SCENARIO)
    if rubric:
        (folder / "source/rubric.toml").write_text(rubric)
    settings = {f"AUTOGRADER_{name.upper()}": str(folder / name) for name in ("source", "submission", "results")}
    settings |= {"SLAMGAUGE_SCENARIO": str(folder / "short.toml"), "SLAMGAUGE_RUNS": "2"}
    settings |= {"SLAMGAUGE_BIN": str(Path(sys.executable).parent)}
    program = str(ROOT / "examples/gradescope/run_autograder")
    ran = subprocess.run([program], env={**os.environ, **settings}, capture_output=True, text=True, check=True)
    return json.loads((folder / "results/results.json").read_text()), ran.stdout


@pytest.mark.full  # a submission with an error is usual
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Gradescope's image is Linux")
def test_the_autograder_gives_all_points_to_a_right_filter(tmp_path: Path):
    files = {"submission.py": STUDENT.read_text(), "plots.py": "1 / 0"}
    found, printed = autograded(tmp_path, files, "total = 20\n")
    assert {*found} > KEYS
    assert (found["score"], found["max_score"], found["extra_data"]["passed"]) == (20, 20, True)
    assert sum(each["max_score"] for each in found["tests"]) == pytest.approx(20, abs=0.1)
    assert {each["status"] for each in found["tests"]} == {"passed"}
    assert found["output"].startswith("Graded is ekf_slam: step function of the exercise")
    assert "root seed" in printed and "1 of 1 graded, 1 passed" in printed


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Gradescope's image is Linux")
def test_the_autograder_explains_a_submission_that_cannot_run(tmp_path: Path):
    found, _ = autograded(tmp_path, {"mine.py": "X = 1 / 0\n"})
    assert found["score"] == 0
    assert found["output"].startswith(
        "nothing could be graded; submission: cannot be loaded, it raised ZeroDivisionError"
    )
