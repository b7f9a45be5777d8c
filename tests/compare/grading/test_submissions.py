"""Submissions that `grade` finds in a folder: names, sources, and reasons why one cannot be graded."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from slamgauge.compare.grading.submissions import submissions_in
from slamgauge.errors import UserError

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (["anna.py", "anna/main.py", "empty/notes.txt"], ["anna", "anna.py"]),
        (
            ["a b.py", "a  b.py", " .py", "c.py", f"{'x' * 255}/main.py"],
            ["#1", "a b #2", "a b #3", "c", f"{'x' * 20} #5"],
        ),
    ],
    ids=["equal names", "names that look alike or cannot name a page"],
)
def test_names_of_submissions_are_distinct(tmp_path: Path, files: list[str], names: list[str]):
    (tmp_path / "without files").mkdir()
    for name in files:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    assert [each.name for each in submissions_in(tmp_path)] == names


def test_a_submission_is_its_folder_without_what_lies_above_or_behind_links(tmp_path: Path):
    for name in ("secret.txt", "solution.py", "class/bob.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("def estimate(recording): ...\n")
    code = "import sys, bob, solution\nsys.path += []\nsys.path.append('/')\nopen('secret.txt'); open('bob.py')\n"
    (tmp_path / "class/eve/lib").mkdir(parents=True)
    (tmp_path / "class/eve/main.py").write_text(code)
    (tmp_path / "class/eve/secret.txt").symlink_to(tmp_path / "secret.txt")
    (tmp_path / "class/eve/endless.py").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "class/eve/waiting.py")
    (tmp_path / "class/fay").mkdir()
    (tmp_path / "class/fay/submission.py").symlink_to(tmp_path / "solution.py")
    (tmp_path / "class/gus.py").write_text(code.replace("bob, ", ""))
    (tmp_path / "class/ida.py").write_text("import bob\n" + "#" * 1_000_000)
    (tmp_path / "class/jon.py").write_text("import bob\n")
    (tmp_path / "class/kim.ipynb").write_text("{}")
    found = {each.name: each for each in submissions_in(tmp_path / "class")}
    files = {
        name: [path for path, _ in each.where.code.files]
        for name, each in found.items()
        if each.where and each.where.code
    }
    assert files == {"bob": ["bob.py"], "eve": ["main.py"], "gus": ["gus.py"], "jon": ["jon.py"]}
    assert found["fay"].reason == "fay: is a link to a file elsewhere; put the file itself there"
    assert (found["kim.ipynb"].reason or "").startswith("kim.ipynb: notebooks are not run; hand in its code")
    assert found["ida"].reason == "ida.py: has more than 1 MB; keep data in other files"


def test_a_missing_folder(tmp_path: Path):
    with pytest.raises(UserError, match="cannot be read"):
        submissions_in(tmp_path / "nowhere")


def test_a_submission_that_is_no_file_has_a_row_and_hides_nothing_from_others(tmp_path: Path):
    """A linked folder ended the whole class with bwrap, and pipes had no row."""
    (tmp_path / "dora.py").write_text("def estimate(recording): ...", encoding="utf-8")
    (tmp_path / "eve").mkdir()
    for pipe in ("bob.py", "eve/submission.py"):
        os.mkfifo(tmp_path / pipe)
    (tmp_path / "carl.py").symlink_to("carl.py")
    (tmp_path / "fred").symlink_to(Path(__file__).parent)
    reasons = {each.name: each.reason for each in submissions_in(tmp_path)}
    no_file = "is or has no Python file (no pipe, no broken link); hand in a file"
    for name, place in (("bob", "bob.py"), ("carl", "carl.py"), ("eve", "eve")):
        assert reasons[name] == f"{place}: {no_file}"
    assert reasons["dora"] == "" and "fred" in reasons
