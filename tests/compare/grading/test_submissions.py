"""Submissions that `grade` finds in a folder: names, main files, sources, and reasons why one cannot be graded."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from slamgauge.compare.grading.submissions import Submission, submissions_in
from slamgauge.errors import UserError

pytestmark = pytest.mark.slow

STEP = "def ekf_slam(xEst, PEst, u, y): ...\n"


def found_in(folder: Path, files: dict[str, str]) -> list[Submission]:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content)
    return submissions_in(folder)


def test_names_of_submissions_are_distinct_and_can_name_a_page(tmp_path: Path):
    files = ["anna.py", "anna/main.py", "empty/notes.txt", "a b.py", "a  b.py", " .py", "c.py", f"{'x' * 255}/main.py"]
    names = ["#1", "a b #2", "a b #3", "anna", "anna.py", "c", f"{'x' * 20} #7"]
    assert [each.name for each in found_in(tmp_path, dict.fromkeys(files, ""))] == names


@pytest.mark.parametrize(
    ("files", "main"),
    [
        ({"submission.py": "", "main.py": STEP, "__init__.py": ""}, "submission"),
        ({"__init__.py": "", "main.py": STEP}, "folder"),
        ({"main.py": "", "other.py": STEP}, "main"),
        ({"plots.py": "", "filter.py": STEP}, "filter"),
        ({"plots.py": "", "filter.py": "class A:\n    def predict(s): ...\n    def update(s): ..."}, "filter"),
        ({"plots.py": "def f(): ...", "filter.py": "estimate = make()"}, "filter"),
        ({"broken.py": "def (", "filter.py": STEP}, "filter"),
        ({"plots.py": "def f():\n    def estimate(): ...", "filter.py": "1 / 0\ndef ekf_slam(): ..."}, "filter"),
        ({"one.py": STEP, "two.py": STEP}, ""),
        ({"TP4/filter.py": STEP, "TP4/plots.py": "", "utils/angle.py": ""}, "filter"),
    ],
)
def test_the_main_file_of_a_folder_is_found_without_running_code(tmp_path: Path, files: dict[str, str], main: str):
    (found,) = found_in(tmp_path, {f"folder/{name}": content for name, content in files.items()})
    if main:
        assert found.where is not None and found.where.code is not None
        assert found.where.code.module == main
    else:
        assert found.reason == f"folder: may be {', '.join(files)}; call the one that counts submission.py"


def test_a_submission_is_its_folder_and_what_is_no_file_has_a_reason_and_hides_nothing_from_others(tmp_path: Path):
    """A linked folder ended the whole class with bwrap, and pipes had no row."""
    for name in ("secret.txt", "solution.py"):
        (tmp_path / name).write_text("def estimate(recording): ...\n")
    folder = tmp_path / "class"
    for name in ("eve/lib", "fay", "pipes"):
        (folder / name).mkdir(parents=True)
    (folder / "eve/secret.txt").symlink_to(tmp_path / "secret.txt")
    (folder / "eve/endless.py").symlink_to("/dev/zero")
    (folder / "fay/submission.py").symlink_to(tmp_path / "solution.py")
    (folder / "carl.py").symlink_to("carl.py")
    (folder / "fred").symlink_to(Path(__file__).parent)
    for pipe in ("eve/waiting.py", "bob.py", "pipes/submission.py"):
        os.mkfifo(folder / pipe)
    code = "import sys, bob, solution\nsys.path.append('/')\nopen('secret.txt'); open('bob.py')\n"
    files = {"eve/main.py": code, "gus.py": code, "ida.py": "#" * 1_000_001, "kim.ipynb": "{}"}
    found = {each.name: each for each in found_in(folder, files)}
    whole = {name: each.where.code.files for name, each in found.items() if each.where and each.where.code}
    assert {name: [path for path, _ in each] for name, each in whole.items()} == {"eve": ["main.py"], "gus": ["gus.py"]}
    no_file = "is or has no Python file (no pipe, no broken link); hand in a file"
    reasons = {
        **{name: f"{place}: {no_file}" for name, place in (("bob", "bob.py"), ("carl", "carl.py"), ("pipes", "pipes"))},
        "fay": "fay: is a link to a file elsewhere; put the file itself there",
        "ida": "ida.py: has more than 1 MB; keep data in other files",
        "kim.ipynb": "kim.ipynb: notebooks are not run; hand in its code as a .py file (jupyter nbconvert --to script)",
    }
    assert {name: found[name].reason for name in reasons} == reasons
    assert "fred" in found
    with pytest.raises(UserError, match="cannot be read"):
        submissions_in(tmp_path / "nowhere")
