"""Import rules of docs/architecture.md, read from the sources by folder, and the modules that a command loads."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
FOLDERS = {"core": "slamgauge", **{name: f"slamgauge.{name}" for name in ("ekf", "graph_baseline", "compare")}}

# Levels of each package from bottom to top, folders or single modules. A module imports its own level and levels below
# it, never one above. Modules that are not listed are on top.
LEVELS = {
    "slamgauge": ("arrays",),
    "slamgauge.ekf": (
        "setting_rules",
        "settings",
        "kernels",
        "maps",
        "online_filter",
        "slam_filter",
        "associating_filter",
        "bearings",
    ),
    "slamgauge.graph_baseline": ("problem", "gtsam_conversions", "gtsam_incremental", "gtsam_batch", "solver"),
    "slamgauge.compare": (
        "storage",
        "scenarios",
        "datasets",
        "estimators",
        "scoring",
        "checks",
        "studies",
        "exercise",
        "noise",
        "grading",
        "bench",
        "figures",
        "report",
        "cli",
    ),
}
# beyond the standard library and slamgauge itself
LIBRARIES = {
    "slamgauge": {"numpy"},
    "slamgauge.jit": {"numba"},
    "slamgauge.display": {"numpy", "pandas"},
    "slamgauge.ekf": {"numpy", "scipy"},
    "slamgauge.ekf.kernels.blas": {"numba", "llvmlite"},
    "slamgauge.graph_baseline": {"numpy", "scipy", "gtsam"},
    "slamgauge.compare": {"numpy", "scipy", "tqdm", "distributed", "filelock", "pydantic", "pydantic_core"},
    "slamgauge.compare.datasets.bag_file": {"apsw", "rosbags"},
    "slamgauge.compare.scenarios": {"pydantic", "pydantic_core"},
    "slamgauge.compare.figures": {"matplotlib"},
    "slamgauge.compare.report": {"jinja2", "markupsafe"},
    "slamgauge.compare.cli": {"tyro"},
}
PACKAGES_BELOW = {
    "slamgauge": (),
    "slamgauge.ekf": ("slamgauge",),
    "slamgauge.graph_baseline": ("slamgauge",),
    "slamgauge.compare": ("slamgauge", "slamgauge.ekf", "slamgauge.graph_baseline"),
}
LAZY = ("slamgauge", "slamgauge.__main__")  # import names of all packages on first use
SLOW_TO_START = ("numpy", "gtsam", "matplotlib", "numba", "scipy", "pydantic")


def sources() -> dict[str, Path]:
    """Return every module of the program by its import name."""
    found: dict[str, Path] = {}
    for folder, package in FOLDERS.items():
        for path in sorted((ROOT / folder).rglob("*.py")):
            name = ".".join((package, *path.relative_to(ROOT / folder).with_suffix("").parts))
            found[name.removesuffix(".__init__")] = path
    return found


SOURCES = sources()


def is_program(node: ast.stmt) -> bool:
    """Return whether a statement is `if __name__ == "__main__":`, which does nothing when the file is imported."""
    return isinstance(node, ast.If) and ast.unparse(node.test) == "__name__ == '__main__'"


def imported(path: Path, modules: dict[str, Path] = SOURCES, *, as_program: bool = False) -> Iterator[str]:
    """Yield all modules that a file imports: at its head, in functions, for type checking.

    With `as_program` those that it imports only if it is run as a program.
    """
    statements = ast.parse(path.read_text(encoding="utf-8")).body
    chosen = ast.Module([each for each in statements if is_program(each) == as_program], [])
    for node in ast.walk(chosen):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            assert node.module is not None
            submodules = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from (name if name in modules else node.module for name in submodules)


NAMES = [name for name in SOURCES if name not in LAZY]


@cache
def imports_of(name: str) -> set[str]:
    """Return all modules that a module imports."""
    return {*imported(SOURCES[name])}


def package_of(name: str) -> str:
    """Return the package of a module."""
    two = ".".join(name.split(".")[:2])
    return two if two in LEVELS else "slamgauge"


def level_of(name: str) -> str:
    """Return the level of a module within its package, "" for modules on top."""
    first = name.removeprefix(package_of(name)).strip(".").split(".")[0]
    return first if first in LEVELS[package_of(name)] else ""


def height(name: str) -> int:
    """Return the index of the module's level, counted from the bottom."""
    levels = LEVELS[package_of(name)]
    return levels.index(level_of(name)) if level_of(name) else len(levels)


def ours(name: str) -> set[str]:
    return {other for other in imports_of(name) if other.partition(".")[0] == "slamgauge" and other not in LAZY}


def test_every_folder_is_a_level_and_every_level_exists() -> None:
    for folder, package in FOLDERS.items():
        folders = {each.parent.name for each in (ROOT / folder).glob("*/__init__.py")}
        modules = {each.stem for each in (ROOT / folder).glob("*.py")}
        assert folders <= {*LEVELS[package]} <= folders | modules


def test_imports_are_found_at_all_places(tmp_path: Path) -> None:
    module = tmp_path / "module.py"
    program = "if __name__ == '__main__':\n    import k\n    f()\n"
    module.write_text(f"import a.b\nfrom c.d import e\ndef f():\n    import g as h\n    from i import j\n{program}")
    assert {*imported(module, {"i.j": module})} == {"a.b", "c.d", "g", "i.j"}
    assert {*imported(module, as_program=True)} == {"k"}


def is_above(other: str, name: str) -> bool:
    """Return whether a module is not below another one."""
    if package_of(other) == package_of(name):
        return height(other) > height(name)
    return package_of(other) not in PACKAGES_BELOW[package_of(name)]


def test_modules_import_from_below() -> None:
    assert not [(name, other) for name in NAMES for other in ours(name) if is_above(other, name)]


def test_only_programs_import_the_public_names() -> None:
    """`slamgauge` has the names of all packages, above a module too; a module imports from the name's home."""
    shown = [name for name in NAMES if "slamgauge" in imports_of(name)]
    assert shown == ["slamgauge.ekf", "slamgauge.compare"]  # these packages show public names
    used = {other for name in NAMES for other in imported(SOURCES[name], as_program=True)}
    assert used - sys.stdlib_module_names == {"slamgauge"}


def test_modules_import_the_libraries_of_their_level() -> None:
    for name in NAMES:
        package = package_of(name)
        allowed = LIBRARIES[package] | LIBRARIES.get(f"{package}.{level_of(name)}", set()) | LIBRARIES.get(name, set())
        libraries = {other.partition(".")[0] for other in imports_of(name)} - sys.stdlib_module_names - {"slamgauge"}
        assert (name, libraries - allowed) == (name, set())


def test_no_imports_in_circles() -> None:
    graph = {name: {other for other in ours(name) if other in NAMES} - {name} for name in NAMES}
    TopologicalSorter(graph).prepare()  # raises an error that names the circle


def loaded_by(statement: str) -> set[str]:
    """Return the modules that a new process has loaded after `statement`."""
    program = f"import sys\n{statement}\nprint(' '.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True, cwd=ROOT)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("statement", ["import slamgauge", "import slamgauge.compare.cli.main"])
def test_the_command_and_the_package_start_without_the_slow_libraries(statement: str) -> None:
    loaded = loaded_by(statement)
    assert statement.split()[1] in loaded
    assert not loaded & set(SLOW_TO_START)


@pytest.mark.parametrize(
    ("words", "status"),
    [
        ("--help", 0),
        ("--version", 0),
        ("run --help", 0),
        ("runn", 2),
        ("run q1-long-dense --sed 3", 2),
        ("run no-such-scenario", 2),
    ],
)
def test_help_version_and_mistakes_load_none_of_the_slow_libraries(words: str, status: int) -> None:
    main = f"status = main({words.split()})\nexcept SystemExit as end: status = end.code"
    loaded = loaded_by(f"from slamgauge.compare.cli.main import main\ntry: {main}\nassert status == {status}")
    assert "slamgauge.compare.cli.main" in loaded
    assert not loaded & {*SLOW_TO_START, "slamgauge.compare.cli.study"}  # each command is imported when it is called


@pytest.mark.parametrize(
    ("package", "never"),
    [("slamgauge.ekf", "gtsam"), ("slamgauge.graph_baseline", "pydantic"), ("slamgauge.recording", "scipy")],
)
def test_a_package_can_be_used_without_the_others_libraries(package: str, never: str) -> None:
    loaded = loaded_by(f"from {package} import *")  # also all lazily imported names
    assert "numpy" in loaded
    assert not loaded & {never, "slamgauge.compare", "matplotlib"}
