"""Run the commands that pages show in the order of the page: small, in this process, and without rendering.

`docs/make_figures.py` parses the blocks of a page and their remarks. Here shipped scenarios last three seconds, studies
have two runs and sweeps one value in a thread instead of processes, and figures are empty. Commands with the same
options run only once, except commands with results that a later one reads. Synthetic logs replace those of real robots.
Benchmarks do not run here, because `tests/benchmarks` runs each at its smallest size; installation commands do not run
either. Commands that wait for others run together in separate processes at the end.
"""

from __future__ import annotations

import re
import runpy
import shlex
import subprocess
import sys
import webbrowser
from pathlib import Path

import pytest

from slamgauge.compare.cli.main import COMMANDS, main
from slamgauge.compare.scenarios import scenario, scenario_files
from tests.marks import in_full
from tests.reference.synthetic_logs import write_published_logs

pytestmark = [pytest.mark.usefixtures("studies_in_a_thread", "empty_pictures"), pytest.mark.slow]

ROOT = Path(__file__).parents[1]
MADE = runpy.run_path(str(ROOT / "docs/make_figures.py"))
PAGES = {path.name: path for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))}
LASTS = 3.0  # s, every scenario
ELSEWHERE = re.compile(rf"{re.escape(MADE['CHECK'])}|^pip install|^dask|^openssl|--scheduler", re.MULTILINE)
SMALLER = (
    *MADE["SMALL"],
    (re.compile(r"slamgauge bench.*?(?= --out|$)"), "slamgauge bench --landmarks 5 --estimators ekf"),
    (re.compile(r"(slamgauge animate \S+).*"), r"\1 --seconds 0.2"),
    (re.compile(r"student_ekf\*\.py"), "student_ekf.py"),
)
FORMS: set[tuple[str, ...]] = set()  # names and options of the commands that have run


def blocks(page: Path) -> list[tuple[str, str, str]]:
    """Return remark, name in the remark, and text of every block of commands or file on a page."""
    found = [piece.groupdict("") for piece in MADE["PIECE"].finditer(page.read_text(encoding="utf-8"))]
    return [
        (each["mark"], each["name"], each["block"])
        for each in found
        if each["language"] == "sh" or each["mark"] == "as"
    ]


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a folder for the commands of a page with the files that a reader has, and small scenarios."""
    (tmp_path / "scenarios").mkdir()
    for name, file in scenario_files.shipped().items():
        text = re.sub(
            r"\bduration = ([\d.]+)", lambda found: f"duration = {min(float(found[1]), LASTS)}", file.read_text()
        )
        (tmp_path / "scenarios" / f"{name}.toml").write_text(text)
    shipped = {path.stem: path for path in (tmp_path / "scenarios").iterdir()}
    for module in (scenario_files, scenario):  # `scenario` resolves `extends`
        monkeypatch.setattr(module, "shipped", lambda: shipped)
    work = tmp_path / "page"
    work.mkdir()
    write_published_logs(work)
    for folder in ("examples", "benchmarks"):
        (work / folder).symlink_to(ROOT / folder)
    (work / "my_filter.py").symlink_to(ROOT / "examples/own_estimator.py")
    monkeypatch.chdir(work)
    monkeypatch.setenv("HOME", str(tmp_path))  # completion goes there
    monkeypatch.setattr(webbrowser, "open", bool)
    monkeypatch.setenv("SHELL", "/bin/bash")  # a terminal has one, a machine for checks may not
    return work


def form_of(words: list[str]) -> tuple[str, ...]:
    """Return the name of a command, the scenario of `run`, and the options."""
    return (*words[1 : 3 if words[1] == "run" else 2], *sorted(word for word in words if word.startswith("--")))


def is_needed(words: list[str], page: str) -> bool:
    """Return whether a command has a new form, or results that another command of the page names."""
    written = [words[words.index(option) + 1] for option in ("--out", "--write") if option in words]
    return form_of(words) not in FORMS or any(len(re.findall(rf"(?<![\w/-]){out}\b", page)) > 1 for out in written)


def run_line(line: str, expected: set[int], page: str) -> None:
    """Run a line of a block."""
    words = shlex.split(line.partition(" > ")[0], comments=True)
    if words[0] == "slamgauge":
        if is_needed(words, page):
            FORMS.add(form_of(words))
            assert main(words[1:]) in expected, line
    elif words[0] == "python" and not words[1].startswith("benchmarks/"):
        subprocess.run([sys.executable, *words[1:]], check=True, capture_output=True)
    elif words[0] != "python":
        subprocess.run(["bash", "-euc", line], check=True, capture_output=True)


# tests/compare/cli has the commands of the other pages in the usual run
SHORT = ("README.md", "index.md", "your_robot.md", "association.md", "scenarios.md")


@pytest.mark.parametrize("page", [*SHORT, *in_full(page for page in PAGES if page not in SHORT)])
def test_every_command_of_a_page(page: str, small: Path):
    found = [each for each in blocks(PAGES[page]) if not ELSEWHERE.search(each[2])]
    shown = "\n".join(block for mark, _, block in found if mark != "as")
    for mark, name, block in found:
        if mark == "as":
            (small / name).write_text(block, encoding="utf-8")
            continue
        for line in lines_of(block):
            run_line(line, {0, 1} if mark == "fails" else {0}, shown)


def lines_of(block: str) -> list[str]:
    """Return the commands of a block at small sizes; of a loop only those of its first round."""
    text = MADE["INSTALLED"].sub("", block).replace("\\\n", " ")
    loop = re.search(r"^for (\w+) in (\S+)[^\n]*; do\n(.*?)^done$", text, re.MULTILINE | re.DOTALL)
    if loop:
        text = text.replace(loop[0], loop[3].replace(f"${loop[1]}", loop[2]))
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    for sizes, smaller in SMALLER:
        lines = [sizes.sub(smaller, line) for line in lines]
    return lines


def test_pages_show_every_command():
    """`doctor` and `scenarios` need no page."""
    lines = [
        line for page in PAGES.values() for mark, _, block in blocks(page) if mark != "as" for line in lines_of(block)
    ]
    shown = {line.split()[1] for line in lines if line.startswith("slamgauge ")}
    assert {*COMMANDS} - shown <= {"doctor", "scenarios"}
