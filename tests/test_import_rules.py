"""Who may import what (DESIGN.md, layout), read from the sources, and what the command line really loads."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("slam2d", "ekf", "graph_baseline", "compare")

# beyond the standard library
ALLOWED = {
    "slam2d": {"numpy"},
    "ekf": {"slam2d", "ekf", "numpy", "scipy", "numba", "llvmlite"},
    "graph_baseline": {"slam2d", "graph_baseline", "numpy", "scipy", "gtsam"},
}
# modules of `compare` that may import what no other may
HOMES = {
    "matplotlib": {
        "animation",
        "animation_scene",
        "ellipses",
        "map_layers",
        "ray_strip",
        "plots",
        "error_panels",
        "plot_style",
        "bench_figure",
        "study_figures",
        "sweep_figure",
        "budget_figure",
    },
    "plotly": {"report"},
    "jinja2": {"report"},
    "tyro": {"cli"},
    "pydantic": {"scenario", "scenario_schema"},
    "pydantic_core": {"scenario", "scenario_schema"},
    "gtsam": set[str](),
}
SLOW_TO_START = ("numpy", "gtsam", "matplotlib", "numba", "scipy", "pydantic")


def sources(package: str) -> list[Path]:
    single = ROOT / f"{package}.py"
    return [single] if single.exists() else sorted((ROOT / package).rglob("*.py"))


def imported(source: Path) -> set[str]:
    """Top-level names that a module imports anywhere: at its head, in functions, for type checking."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(source.parent.name if node.level else node.module or "")
    return {name.partition(".")[0] for name in names}


def foreign(source: Path) -> set[str]:
    return imported(source) - sys.stdlib_module_names


def test_every_package_is_found() -> None:
    assert [len(sources(package)) > 1 for package in PACKAGES] == [False, True, True, True]


def test_imports_are_seen_wherever_they_stand(tmp_path: Path) -> None:
    module = tmp_path / "module.py"
    module.write_text("import a.b\nfrom c.d import e\ndef f():\n    import g as h\n    from . import i\n")
    assert imported(module) == {"a", "c", "g", tmp_path.name}


@pytest.mark.parametrize("package", ALLOWED)
def test_a_package_imports_nothing_else(package: str) -> None:
    found = {source.name: foreign(source) - ALLOWED[package] for source in sources(package)}
    assert not {name: names for name, names in found.items() if names}


@pytest.mark.parametrize(("package", "other"), [("ekf", "graph_baseline"), ("graph_baseline", "ekf")])
def test_filters_and_optimum_know_neither_each_other_nor_compare(package: str, other: str) -> None:
    assert not [source.name for source in sources(package) if imported(source) & {other, "compare"}]


@pytest.mark.parametrize("library", HOMES)
def test_a_library_is_imported_at_its_home_alone(library: str) -> None:
    users = {source.stem for source in sources("compare") if library in imported(source)}
    assert users <= HOMES[library]


def test_gtsam_is_imported_in_graph_baseline_alone() -> None:
    users = {package for package in PACKAGES for source in sources(package) if "gtsam" in imported(source)}
    assert users == {"graph_baseline"}


def loaded_by(statement: str) -> set[str]:
    """Top-level modules that a fresh process has loaded after `statement`."""
    program = f"import sys\n{statement}\nprint(' '.join({{name.partition('.')[0] for name in sys.modules}}))"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True, cwd=ROOT)
    return set(done.stdout.split())


def test_the_command_line_starts_without_the_slow_libraries() -> None:
    loaded = loaded_by("import compare.cli")
    assert {"compare", "tyro"} <= loaded
    assert not loaded & set(SLOW_TO_START)


@pytest.mark.parametrize(("package", "never"), [("ekf", "gtsam"), ("graph_baseline", "numba"), ("slam2d", "scipy")])
def test_a_package_can_be_used_without_the_others_libraries(package: str, never: str) -> None:
    loaded = loaded_by(f"import {package}")
    assert "numpy" in loaded
    assert not loaded & {never, "compare", "matplotlib"}
