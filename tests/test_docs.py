"""Links, files, benchmarks, options of commands and imported names on the pages exist."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
import subprocess
from pathlib import Path

import pytest

from slamgauge.compare.cli.main import main

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
FLOORS = ("core", "ekf", "graph_baseline", "compare")
PACKAGES = sorted({path.parent for floor in FLOORS for path in (ROOT / floor).rglob("__init__.py")})
PAGES = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for path in (*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(package / "README.md" for package in PACKAGES))
    if path.exists()
}
FENCE = re.compile(r"^ *```(\w*)\n(.*?)^ *```$", re.DOTALL | re.MULTILINE)
CODE = [
    (page, block) for page, text in PAGES.items() for language, block in FENCE.findall(text) if language == "python"
]
SHELL = re.sub(
    r"\\\n", " ", "\n".join(block for text in PAGES.values() for lang, block in FENCE.findall(text) if lang == "sh")
)


def test_every_package_says_what_is_in_it():
    assert not [path for path in PACKAGES if not (path / "README.md").read_text(encoding="utf-8").startswith("# ")]


@pytest.mark.parametrize("page", PAGES)
def test_links_and_paths_in_the_text_exist(page: str):
    text, top = FENCE.sub("", PAGES[page]), "|".join((*FLOORS, "tests", "benchmarks", "examples", "docs"))
    links = [link for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text) if "://" not in link]
    paths = re.findall(rf"`((?:{top})/[\w./-]*)`", text) if page != "CHANGELOG.md" else []  # it names deleted files
    here = (ROOT / page).parent
    assert not [path for path in [here / link for link in links] + [ROOT / path for path in paths] if not path.exists()]


def test_benchmarks_that_are_named_exist_and_have_those_options():
    named = re.findall(r"python (benchmarks/\w+\.py)(.*)", "\n".join(PAGES.values()))
    assert len({path for path, _ in named}) > 5
    for path, arguments in named:
        usage = (ROOT / path).read_text(encoding="utf-8").split("\n\n")[1]  # tests/benchmarks compares it with `main`
        assert {*re.findall(r"--\w+", arguments)} <= {*re.findall(r"--\w+", usage)}


@pytest.mark.parametrize(("page", "block"), CODE, ids=[f"{page}-{i}" for i, (page, _) in enumerate(CODE)])
def test_python_on_a_page_imports_names_that_exist(page: str, block: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(ROOT / "examples/adapters")  # a block is a file of this folder
    tree = ast.parse(block, filename=page)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                importlib.import_module(alias.name)
        elif isinstance(node, ast.ImportFrom):
            assert node.module is not None
            module = importlib.import_module(node.module)
            assert not [alias.name for alias in node.names if not hasattr(module, alias.name)]


COMMANDS = [shlex.split(line, comments=True) for line in re.findall(r"(?:^|/)slamgauge (.*)", SHELL, re.MULTILINE)]


@pytest.mark.parametrize("command", sorted({command for command, *_ in COMMANDS}))
def test_commands_on_a_page_have_those_options(command: str, capsys: pytest.CaptureFixture[str]):
    """For `slamgauge import FORMAT` and `export FORMAT` the options of each format are compared."""
    used = [words[1:] for words in COMMANDS if words[0] == command]
    starts = {(command, words[0]) if command in ("import", "export") else (command,) for words in used}
    for start in starts:
        with pytest.raises(SystemExit) as done:
            main([*start, "--help"])
        assert done.value.code == 0
        told = capsys.readouterr().out
        options = {word.split("=")[0] for words in used if (command, *words)[: len(start)] == start for word in words}
        assert not [option for option in options if option.startswith("--") and option not in told]


def test_the_walk_of_one_step_goes_where_it_says():
    """Every name of the table is in the module of its row, or of the last row that has a module."""
    walk = PAGES["docs/architecture.md"].partition("## One step")[2]
    rows = re.findall(r"^\| (?:`([\w.]+)`)? ?\| (`.*?`) \|", walk, re.MULTILINE)
    assert len(rows) > 12
    source = ""
    for module, names in rows:
        if module:
            source = (ROOT / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8")
        for name in re.findall(r"`([\w.]+)`", names):
            assert re.search(rf"^ *(def |class )?{name.rpartition('.')[2]}\b", source, re.MULTILINE), (module, name)


def test_no_page_or_program_names_a_place_on_somebodys_machine():
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False).stdout.split()
    places = re.compile(r"/(?:home|Users|root|work)/\w+")
    files = [ROOT / name for name in listed if name.endswith((".md", ".py", ".toml", ".yaml", ".yml", "run"))]
    assert not [str(path) for path in files if path.exists() and places.search(path.read_text(encoding="utf-8"))]
