"""Run the commands of each page in its order, in this process: small scenarios and studies, empty figures, made logs.

Benchmarks run in `tests/benchmarks`. `docs/make_figures.py` parses the pages.
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

from slamgauge.compare.cli.main import COMMANDS, COMPLETION, main
from slamgauge.compare.scenarios import scenario, scenario_files
from tests.marks import in_full
from tests.reference.synthetic_logs import write_published_logs

pytestmark = [pytest.mark.usefixtures("studies_in_a_thread", "empty_pictures"), pytest.mark.slow]

ROOT = Path(__file__).parents[1]
MADE = runpy.run_path(str(ROOT / "docs/make_figures.py"))
PAGES = {path.name: path for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))}
USUAL = ("README.md", "index.md", "scenarios.md")
OTHER_TOOLS = {"--nthreads", "--no-dashboard", "--ros-args", "--seeds", "--system-site-packages", "--to"}
ELSEWHERE = re.compile(rf"{re.escape(MADE['CHECK'])}|^pip install|^pytest|^dask|^openssl|--scheduler", re.MULTILINE)
SMALLER = (
    *MADE["SMALL"],
    (re.compile(r"slamgauge bench.*?(?= --out|$)"), "slamgauge bench --landmarks 5 --estimators ekf"),
    (re.compile(r"(slamgauge animate \S+).*"), r"\1 --seconds 0.2"),
    (re.compile(r"student_ekf\*\.py"), "student_ekf.py"),
    (re.compile(r"\bduration = [\d.]+"), "duration = 3.0"),
)


def small(text: str) -> str:
    for sizes, smaller in SMALLER:
        text = sizes.sub(smaller, text)
    return text


def blocks(page: Path) -> list[tuple[str, str, list[str]]]:
    """Return remark, name in the remark, and lines of every block of commands or file; a loop has its first round."""
    found: list[tuple[str, str, list[str]]] = []
    for piece in MADE["PIECE"].finditer(page.read_text(encoding="utf-8")):
        each = piece.groupdict("")
        if each["mark"] == "as":
            found.append(("as", each["name"], [each["block"]]))
        elif each["language"] == "sh" and not ELSEWHERE.search(each["block"]):
            text = MADE["INSTALLED"].sub("", each["block"]).replace("\\\n", " ")
            loop = re.search(r"^for (\w+) in (\S+)[^\n]*; do\n(.*?)^done$", text, re.MULTILINE | re.DOTALL)
            text = text if loop is None else text.replace(loop[0], loop[3].replace(f"${loop[1]}", loop[2]))
            found.append((each["mark"], each["name"], [small(line.strip()) for line in text.splitlines() if line]))
    return found


@pytest.mark.parametrize("page", [*USUAL, *in_full(page for page in PAGES if page not in USUAL)])
def test_every_command_of_a_page(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "scenarios").mkdir()
    files = scenario_files.shipped()
    shipped = {name: tmp_path / f"scenarios/{name}.toml" for name in files}
    for name, file in files.items():
        shipped[name].write_text(small(file.read_text()))
    for module in (scenario_files, scenario):  # `scenario` resolves `extends`
        monkeypatch.setattr(module, "shipped", lambda: shipped)
    write_published_logs(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (tmp_path / "my_filter.py").symlink_to(ROOT / "examples/own_estimator.py")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(webbrowser, "open", bool)
    for mark, name, lines in blocks(PAGES[page]):
        if mark == "as":
            (tmp_path / name).write_text(lines[0], encoding="utf-8")
            continue
        for line in lines:
            words = shlex.split(line.partition(" > ")[0], comments=True)
            if words[:1] == ["slamgauge"]:
                assert main(words[1:]) in ({0, 1} if mark == "fails" else {0}), line
            elif words[:1] == ["python"]:
                subprocess.run([sys.executable, *words[1:]], check=True, capture_output=True)
            elif words:
                subprocess.run(["bash", "-euc", line], check=True, capture_output=True)


def test_pages_show_every_command():
    """`doctor` and `scenarios` need no page."""
    lines = [line for page in PAGES.values() for _, _, found in blocks(page) for line in found]
    assert {*COMMANDS} - {line.split()[1] for line in lines if line.startswith("slamgauge ")} <= {"doctor", "scenarios"}


def test_options_in_the_text_are_those_of_a_command(capsys: pytest.CaptureFixture[str]):
    texts = [re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE) for page in PAGES.values()]
    for words in ([COMPLETION, "bash"], ["import", "csv", "--help"], ["export", "csv", "--help"]):
        with pytest.raises(SystemExit):
            main(words)
    options = re.findall(r"'(--[a-z][a-z-]+)'", capsys.readouterr().out)  # the completion script names all
    named = {option for text in texts for option in re.findall(r"(?<![\w-])--[a-z][a-z-]+", text)}
    assert len(named) > 40
    assert named - {*OTHER_TOOLS, COMPLETION, *options} == set()
