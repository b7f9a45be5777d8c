"""Who may import what (docs/architecture.md), read from the sources by folder, and what a command really loads."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FLOORS = ("slamgauge", "ekf", "graph_baseline", "compare")  # folders; all but the first are mapped into it

# rooms from the ground up: a room imports rooms below it, never one above
ROOMS = {
    "slamgauge": (),
    "slamgauge.ekf": ("settings", "kernels", "maps", "bearings", "window"),
    "slamgauge.graph_baseline": (),
    "slamgauge.compare": (
        "storage",
        "scenarios",
        "datasets",
        "estimators",
        "scoring",
        "checks",
        "studies",
        "noise",
        "grading",
        "bench",
        "schemas",
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
    "slamgauge.kernel_cache": {"numba"},
    "slamgauge.ekf": {"numpy", "scipy"},
    "slamgauge.ekf.kernels.blas": {"numba", "llvmlite"},
    "slamgauge.graph_baseline": {"numpy", "scipy", "gtsam"},
    "slamgauge.compare": {"numpy", "scipy", "tqdm", "distributed"},
    "slamgauge.compare.scenarios": {"pydantic", "pydantic_core"},
    "slamgauge.compare.figures": {"matplotlib"},
    "slamgauge.compare.report": {"jinja2", "markupsafe"},
    "slamgauge.compare.cli": {"tyro"},
}
FLOORS_BELOW = {
    "slamgauge": (),
    "slamgauge.ekf": ("slamgauge",),
    "slamgauge.graph_baseline": ("slamgauge",),
    "slamgauge.compare": ("slamgauge", "slamgauge.ekf", "slamgauge.graph_baseline"),
}
DOORS = ("slamgauge", "slamgauge.__main__")  # they offer names of all floors, and import them when asked to
SLOW_TO_START = ("numpy", "gtsam", "matplotlib", "numba", "scipy", "pydantic")


def sources() -> dict[str, Path]:
    """Every module of the program by its import name."""
    found: dict[str, Path] = {}
    for floor in FLOORS:
        for path in sorted((ROOT / floor).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            name = ".".join(parts if floor == "slamgauge" else ("slamgauge", *parts))
            found[name.removesuffix(".__init__")] = path
    return found


SOURCES = sources()


def imported(path: Path, modules: dict[str, Path] = SOURCES) -> Iterator[str]:
    """Modules that a file imports anywhere: at its head, in functions, for type checking."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            assert node.module is not None
            submodules = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from (name if name in modules else node.module for name in submodules)


IMPORTS = {name: {*imported(path)} for name, path in SOURCES.items() if name not in DOORS}


def floor_of(name: str) -> str:
    """The floor of a module."""
    two = ".".join(name.split(".")[:2])
    return two if two in ROOMS else "slamgauge"


def room_of(name: str) -> str:
    """The room of a module within its floor, "" for what lies outside its rooms."""
    rest = name.removeprefix(floor_of(name)).strip(".").split(".")[0]
    return rest if rest in ROOMS[floor_of(name)] else ""


def height(name: str) -> int:
    """The room's place from the ground up; what lies at a floor's root is on top of its rooms."""
    rooms = ROOMS[floor_of(name)]
    return rooms.index(room_of(name)) if room_of(name) else len(rooms)


def ours(name: str) -> set[str]:
    return {other for other in IMPORTS[name] if other.partition(".")[0] == "slamgauge" and other not in DOORS}


def test_every_folder_is_a_room_and_every_room_is_there() -> None:
    for floor, rooms in ROOMS.items():
        folder = ROOT / (floor.rpartition(".")[2])
        assert {each.parent.name for each in folder.glob("*/__init__.py")} == {*rooms}


def test_imports_are_seen_wherever_they_stand(tmp_path: Path) -> None:
    module = tmp_path / "module.py"
    module.write_text("import a.b\nfrom c.d import e\ndef f():\n    import g as h\n    from i import j\n")
    assert {*imported(module, {"i.j": module})} == {"a.b", "c.d", "g", "i.j"}


@pytest.mark.parametrize("name", IMPORTS)
def test_a_module_imports_from_below(name: str) -> None:
    above = {other for other in ours(name) if floor_of(other) == floor_of(name) and height(other) > height(name)}
    allowed = {*FLOORS_BELOW[floor_of(name)], floor_of(name)}
    assert not above | {other for other in ours(name) if floor_of(other) not in allowed}


@pytest.mark.parametrize("name", IMPORTS)
def test_a_module_imports_the_libraries_of_its_room(name: str) -> None:
    floor = floor_of(name)
    allowed = LIBRARIES[floor] | LIBRARIES.get(f"{floor}.{room_of(name)}", set()) | LIBRARIES.get(name, set())
    assert {other.partition(".")[0] for other in IMPORTS[name]} - sys.stdlib_module_names - {"slamgauge"} <= allowed


def test_no_imports_in_circles() -> None:
    graph = {name: {other for other in ours(name) if other in IMPORTS} - {name} for name in IMPORTS}
    TopologicalSorter(graph).prepare()  # names the circle if there is one


def loaded_by(statement: str) -> set[str]:
    """Modules that a fresh process has loaded after `statement`."""
    program = f"import sys\n{statement}\nprint(' '.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True, cwd=ROOT)
    return set(done.stdout.split())


@pytest.mark.parametrize("statement", ["import slamgauge", "import slamgauge.compare.cli.main"])
def test_the_command_and_the_package_start_without_the_slow_libraries(statement: str) -> None:
    loaded = loaded_by(statement)
    assert statement.split()[1] in loaded
    assert not loaded & set(SLOW_TO_START)


@pytest.mark.parametrize(
    ("package", "never"),
    [("slamgauge.ekf", "gtsam"), ("slamgauge.graph_baseline", "pydantic"), ("slamgauge.recording", "scipy")],
)
def test_a_floor_can_be_used_without_the_others_libraries(package: str, never: str) -> None:
    loaded = loaded_by(f"from {package} import *")  # all that it offers lazily, too
    assert "numpy" in loaded
    assert not loaded & {never, "slamgauge.compare", "matplotlib"}
