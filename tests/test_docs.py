"""Links, files, benchmarks and imported names on the pages exist; `test_commands_of_pages` runs their commands."""

from __future__ import annotations

import ast
import re
import subprocess
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
FLOORS = ("core", "ekf", "graph_baseline", "compare")
PACKAGES = sorted({path.parent for floor in FLOORS for path in (ROOT / floor).rglob("__init__.py")})
PAGES = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for path in (*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(package / "README.md" for package in PACKAGES))
}
FENCE = re.compile(r"^ *```(\w*)\n(.*?)^ *```$", re.DOTALL | re.MULTILINE)


def test_links_and_paths_in_the_text_exist_and_every_package_has_a_page():
    tops, wrong = "|".join((*FLOORS, "tests", "benchmarks", "examples", "docs")), list[str]()
    for page, whole in PAGES.items():
        text = FENCE.sub("", whole)
        links = [link for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text) if "://" not in link]
        paths = re.findall(r"python (benchmarks/\w+\.py)", whole)
        paths += re.findall(rf"`((?:{tops})/[\w./-]*)`", text) if page != "CHANGELOG.md" else []  # it names old files
        found = [(ROOT / page).parent / link for link in links] + [ROOT / path for path in paths]
        wrong += [f"{page}: {path}" for path in found if not path.exists()]
    assert wrong == []


def test_python_on_a_page_imports_names_that_exist(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(ROOT / "examples/adapters")  # a block is a file of this folder
    blocks = [block for text in PAGES.values() for language, block in FENCE.findall(text) if language == "python"]
    assert blocks
    for node in (node for block in blocks for node in ast.walk(ast.parse(block))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            exec(ast.unparse(node))


def test_no_file_names_a_place_on_somebodys_machine():
    words = ["git", "grep", "-IlE", r"/(home|Users|root|work)/\w+"]
    assert subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False).stdout == ""


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
