"""The names that `slamgauge` offers: said twice, imported when they are used."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import slamgauge
from slamgauge.ekf import estimators

TREE = ast.parse(Path(slamgauge.__file__).read_text(encoding="utf-8"))
HOME: dict[str, str] = slamgauge._HOME  # pyright: ignore[reportPrivateUsage]
ALL: list[str] = getattr(slamgauge, "__all__")  # noqa: B009 made when it is asked for
FILTERS = {*estimators.__all__}
PACKAGES = {"compare", "ekf", "graph_baseline"}


def test_the_names_for_type_checkers_are_the_names_that_are_imported() -> None:
    (block,) = (node for node in TREE.body if isinstance(node, ast.If))
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    typed = {alias.name: (node.module or "").removeprefix("slamgauge.") for node in imports for alias in node.names}
    assert typed.pop("*") == "ekf.estimators"  # which lists its names itself
    assert typed.pop("estimators") == "ekf"
    assert typed == HOME
    *_, exported, _ = block.body  # for type checkers, which do not look into `__getattr__`
    assert len(imports) == len(block.body) - 2
    assert isinstance(exported, ast.Assign)
    assert set(ast.literal_eval(exported.value)) == {*HOME, "__version__"}
    assert set(ALL) == {*HOME, *FILTERS, "__version__"}
    assert len(ALL) == len(set(ALL))


@pytest.mark.parametrize("name", sorted({*ALL, *PACKAGES}))
def test_every_public_name_is_there(name: str) -> None:
    assert getattr(slamgauge, name) is not None


def test_all_names_are_listed() -> None:
    assert dir(slamgauge) == sorted({*ALL, *PACKAGES})


def test_other_names_are_refused_as_python_does() -> None:
    with pytest.raises(AttributeError, match="module 'slamgauge' has no attribute 'slam'"):
        _ = slamgauge.slam  # pyright: ignore[reportAttributeAccessIssue]


def test_the_import_costs_nothing() -> None:
    """The best of five fresh processes, as Python itself measures its imports: most of a second with numpy."""
    command = [sys.executable, "-X", "importtime", "-c", "import slamgauge, sys; print('numpy' in sys.modules)"]
    microseconds: list[int] = []
    for _ in range(5):
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        assert done.stdout == "False\n"
        (line,) = (line for line in done.stderr.splitlines() if line.rpartition("|")[2].strip() == "slamgauge")
        microseconds.append(int(line.split("|")[1]))
    assert min(microseconds) < 100_000
