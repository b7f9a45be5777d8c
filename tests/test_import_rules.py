"""Import rules of docs/architecture.md, the libraries of each folder, and the modules that a command loads."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
FOLDERS = {"core": "slamgauge", **{name: f"slamgauge.{name}" for name in ("ekf", "graph_baseline", "compare")}}

# Folders and modules from bottom to top. A module has the level of the longest name that it begins with, and imports
# from its own level and the levels below. `ekf` and `graph_baseline` do not import each other.
LEVELS = (
    "slamgauge.arrays",
    "slamgauge",
    "slamgauge.ekf.setting_rules",
    "slamgauge.ekf.settings",
    "slamgauge.ekf.kernels",
    "slamgauge.ekf.maps",
    "slamgauge.ekf.online_filter",
    "slamgauge.ekf.slam_filter",
    "slamgauge.ekf.associating_filter",
    "slamgauge.ekf.bearings",
    "slamgauge.ekf",
    "slamgauge.graph_baseline.problem",
    "slamgauge.graph_baseline.gtsam_conversions",
    "slamgauge.graph_baseline.gtsam_incremental",
    "slamgauge.graph_baseline.gtsam_batch",
    "slamgauge.graph_baseline.solver",
    "slamgauge.graph_baseline",
    "slamgauge.compare.storage",
    "slamgauge.compare.scenarios",
    "slamgauge.compare.datasets",
    "slamgauge.compare.estimators",
    "slamgauge.compare.scoring",
    "slamgauge.compare.checks",
    "slamgauge.compare.studies",
    "slamgauge.compare.exercise",
    "slamgauge.compare.noise",
    "slamgauge.compare.grading",
    "slamgauge.compare.figures",
    "slamgauge.compare.report",
    "slamgauge.compare.cli",
    "slamgauge.compare",
)
# beyond the standard library and slamgauge itself, for all modules whose names begin so
LIBRARIES = {
    "slamgauge": {"numpy"},
    "slamgauge.blas_threads": {"threadpoolctl"},
    "slamgauge.jit": {"numba"},
    "slamgauge.ekf": {"scipy"},
    "slamgauge.ekf.kernels.blas": {"numba", "llvmlite"},
    "slamgauge.graph_baseline": {"scipy", "gtsam"},
    "slamgauge.compare": {"scipy", "tqdm", "distributed", "filelock", "pydantic", "pydantic_core"},
    "slamgauge.compare.datasets.bag_file": {"rosbags"},
    "slamgauge.compare.figures": {"matplotlib"},
    "slamgauge.compare.report": {"jinja2", "markupsafe"},
    "slamgauge.compare.cli": {"tyro"},
    "slamgauge.compare.noise": {"iminuit"},
}
LAZY = ("slamgauge", "slamgauge.__main__")  # import names of all packages on first use
SLOW_TO_START = ("numpy", "gtsam", "matplotlib", "numba", "scipy", "pydantic")
ONCE_CALLED = (*SLOW_TO_START, "slamgauge.compare.cli.study")  # each command is imported when it is called
MAIN = "from slamgauge.compare.cli.main import main; main"
FILES = {
    ".".join((package, *path.relative_to(ROOT / folder).with_suffix("").parts)).removesuffix(".__init__"): path
    for folder, package in FOLDERS.items()
    for path in (ROOT / folder).rglob("*.py")
}
NAMES = [name for name in FILES if name not in LAZY]


@cache
def imports_of(name: str) -> frozenset[str]:
    """Return all modules that a module imports."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(FILES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 and node.module is not None, f"{name}: a relative import"
            submodules = [f"{node.module}.{alias.name}" for alias in node.names]
            found |= {each if each in FILES else node.module for each in submodules}
    return frozenset(found)


def ours(name: str) -> set[str]:
    return {other for other in imports_of(name) if other.partition(".")[0] == "slamgauge" and other not in LAZY}


def libraries(name: str) -> set[str]:
    return {other.partition(".")[0] for other in imports_of(name)} - sys.stdlib_module_names - {"slamgauge"}


def is_within(name: str, place: str) -> bool:
    return f"{name}.".startswith(f"{place}.")


def level(name: str) -> int:
    """Return the index of a module's level, counted from the bottom."""
    return LEVELS.index(max((place for place in LEVELS if is_within(name, place)), key=len))


def test_modules_import_from_below() -> None:
    assert {*LEVELS} <= {*FILES}
    assert not [(name, other) for name in NAMES for other in ours(name) if level(other) > level(name)]
    filters, graphs = ([name for name in NAMES if is_within(name, FOLDERS[each])] for each in ("ekf", "graph_baseline"))
    assert not {other for name in graphs for other in ours(name)} & {*filters}


def test_no_imports_in_circles() -> None:
    graph = {name: {other for other in ours(name) if other in NAMES} - {name} for name in NAMES}
    TopologicalSorter(graph).prepare()  # raises an error that names the circle


def test_modules_import_the_libraries_of_their_folder_which_are_the_declared_ones() -> None:
    for name in NAMES:
        allowed = {library for place, those in LIBRARIES.items() if is_within(name, place) for library in those}
        assert (name, libraries(name) - allowed) == (name, set())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    declared = [*project["dependencies"], *extras["cluster"], *extras["ros"]]
    names = {re.split(r"[^\w-]", each, maxsplit=1)[0].replace("-", "_") for each in declared}
    assert {library for name in FILES for library in libraries(name)} == names


@pytest.mark.parametrize(
    ("statement", "never"),
    [
        ("import slamgauge", (*SLOW_TO_START, "threadpoolctl", "dataclasses")),  # a user's folder may have such files
        ("from slamgauge.ekf import *", ("gtsam", "slamgauge.compare", "matplotlib")),
        ("from slamgauge.graph_baseline import *", ("pydantic", "slamgauge.compare", "matplotlib")),
        ("from slamgauge.recording import *", ("scipy", "slamgauge.compare", "matplotlib")),
        *((f"{MAIN}({words})", ONCE_CALLED) for words in (["run", "--help"], ["run", "--sed"], ["run", "no-such"])),
    ],
)
def test_a_new_process_loads_only_the_libraries_that_it_needs(statement: str, never: tuple[str, ...]) -> None:
    program = f"import atexit, sys\natexit.register(lambda: print(' '.join(sys.modules)))\n{statement}"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True, cwd=ROOT)
    loaded = set(done.stdout.splitlines()[-1].split())
    assert statement.split()[1] in loaded
    assert not loaded & {*never}
