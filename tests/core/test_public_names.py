"""The public names of `slamgauge`: each can be imported, and the import of the package loads nothing else."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path

import pytest

import slamgauge

ALL: list[str] = getattr(slamgauge, "__all__")  # noqa: B009 made on request
PACKAGES = {"compare", "ekf", "graph_baseline"}


def test_every_public_name_can_be_imported() -> None:
    assert not [name for name in (*ALL, *PACKAGES) if getattr(slamgauge, name) is None]


def test_the_python_page_documents_every_public_name() -> None:
    page = (Path(__file__).parents[2] / "docs/python.md").read_text(encoding="utf-8")
    documented = re.findall(r"^\.\. (?:data|auto\w+):: (\w+)$", page, re.MULTILINE)
    assert sorted(documented) == sorted(ALL)
    functions = [name for name in ALL if inspect.isroutine(getattr(slamgauge, name))]
    assert not [name for name in functions if not inspect.getdoc(getattr(slamgauge, name))]


@pytest.mark.parametrize(
    "name",
    [name for name in ALL if inspect.isclass(getattr(slamgauge, name)) and is_dataclass(getattr(slamgauge, name))],
)
def test_the_docstring_of_a_public_dataclass_describes_each_field(name: str) -> None:
    described = inspect.getdoc(getattr(slamgauge, name)) or ""
    names = {*re.findall(r"`(\w+)`", described), *re.findall(r"^    (\w+): \S", described, re.MULTILINE)}
    found = {each.name for each in fields(getattr(slamgauge, name)) if not each.name.startswith("_")}
    assert found <= names, found - names


def test_all_names_are_listed() -> None:
    assert dir(slamgauge) == sorted({*ALL, *PACKAGES})


def test_other_names_raise_the_usual_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'slamgauge' has no attribute 'slam'"):
        _ = slamgauge.slam


def test_the_import_loads_no_numpy() -> None:
    command = [sys.executable, "-c", "import slamgauge, sys; print('numpy' in sys.modules)"]
    assert subprocess.run(command, check=True, capture_output=True, text=True).stdout == "False\n"
