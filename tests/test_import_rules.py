"""Libraries of each folder, and the modules that a command loads; import-linter checks imports of our own modules."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
SOURCES = [path for folder in ("core", "ekf", "graph_baseline", "compare") for path in (ROOT / folder).rglob("*.py")]
WITH_NAMES = [ROOT / folder / "__init__.py" for folder in ("core", "ekf", "graph_baseline")]

# beyond the standard library and slamgauge itself, for this file or all files of this folder
LIBRARIES = {
    ".": {"numpy"},
    "core/blas_threads.py": {"threadpoolctl"},
    "core/jit.py": {"numba"},
    "ekf": {"scipy"},
    "ekf/kernels/blas.py": {"numba", "llvmlite"},
    "graph_baseline": {"scipy", "gtsam"},
    "compare": {"scipy", "tqdm", "distributed", "filelock", "pydantic", "pydantic_core"},
    "compare/datasets/bag_file.py": {"rosbags"},
    "compare/figures": {"matplotlib"},
    "compare/report": {"jinja2", "markupsafe"},
    "compare/cli": {"tyro"},
    "compare/noise": {"iminuit"},
}
SLOW_TO_START = ("numpy", "gtsam", "matplotlib", "numba", "scipy", "pydantic")
ONCE_CALLED = (*SLOW_TO_START, "slamgauge.compare.cli.study")  # each command is imported when it is called
MAIN = "from slamgauge.compare.cli.main import main; main"


def imports_of(path: Path) -> set[str]:
    """Return the packages that a file imports."""
    nodes = [*ast.walk(ast.parse(path.read_text(encoding="utf-8")))]
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)]
    return {name.partition(".")[0] for name in names}


def test_files_import_the_libraries_of_their_folder_which_are_the_declared_ones() -> None:
    imported = {path: imports_of(path) - sys.stdlib_module_names - {"slamgauge"} for path in SOURCES}
    for path, libraries in imported.items():
        allowed = {each for place, those in LIBRARIES.items() if path.is_relative_to(ROOT / place) for each in those}
        assert (path, libraries - allowed) == (path, set())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    declared = [*project["dependencies"], *extras["cluster"], *extras["ros"]]
    names = {re.split(r"[^\w-]", each, maxsplit=1)[0].replace("-", "_") for each in declared}
    assert set().union(*imported.values()) == names


def test_packages_other_than_three_have_only_a_docstring() -> None:
    """Imports in them could make a circle of a package and its own modules, which import-linter does not find."""
    inits = {path for path in SOURCES if path.name == "__init__.py"} - {*WITH_NAMES}
    assert [path for path in inits if len(ast.parse(path.read_text(encoding="utf-8")).body) > 1] == []


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
