"""Remarks for the teacher, and the main file of a submission: both are found without running any code."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamgauge.compare.grading.grades import figure_remarks
from slamgauge.compare.grading.submissions import submissions_in

from ..scoring.test_error_bounds import scores

pytestmark = pytest.mark.slow

STEP = "def ekf_slam(xEst, PEst, u, y): ...\n"


def test_identical_figures_are_named_on_both_sides():
    one, other = scores(ate=1.0, spread=0.1), scores(ate=1.0 + 1e-12, spread=0.1)
    found = figure_remarks(
        {"anna": one, "bert": other, "carl": [*one], "dora": [], "emil": [], "(ekf)": other}, "(ekf)"
    )
    assert found.pop("(ekf)") == ["same figures as bert"]
    assert found == {
        "anna": ["same figures as carl"],
        "carl": ["same figures as anna"],
        "bert": ["same figures as the reference (ekf)"],
    }


@pytest.mark.parametrize(
    ("files", "main"),
    [
        ({"submission.py": "", "main.py": STEP, "__init__.py": ""}, "submission"),
        ({"__init__.py": "", "main.py": STEP}, "folder"),
        ({"main.py": "", "other.py": STEP}, "main"),
        ({"plots.py": "", "filter.py": STEP}, "filter"),
        ({"plots.py": "", "filter.py": "class A:\n    def predict(s): ...\n    def correct(s): ..."}, "filter"),
        ({"plots.py": "def f(): ...", "filter.py": "estimate = make()"}, "filter"),
        ({"broken.py": "def (", "filter.py": STEP}, "filter"),
        ({"plots.py": "def f():\n    def estimate(): ...", "filter.py": "1 / 0\ndef correction_step(): ..."}, "filter"),
        ({"one.py": STEP, "two.py": STEP}, ""),
        ({"one.py": "", "two.py": ""}, ""),
        ({"TP4/filter.py": STEP, "TP4/plots.py": "", "utils/angle.py": ""}, "filter"),
        ({"a/one.py": STEP, "b/two.py": STEP}, ""),
    ],
)
def test_the_main_file_of_a_folder(tmp_path: Path, files: dict[str, str], main: str):
    for name, content in files.items():
        (tmp_path / "folder" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "folder" / name).write_text(content)
    (found,) = submissions_in(tmp_path)
    if main:
        assert found.where is not None and found.where.sources is not None
        assert found.where.sources.module == main
    else:
        assert found.reason == f"folder: may be {', '.join(files)}; call the one that counts submission.py"
