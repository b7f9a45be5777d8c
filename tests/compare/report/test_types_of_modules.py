"""TypeScript checks the types of the JavaScript modules."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from slamgauge.compare.report.page import MODULES
from tests.reference.external_programs import program

pytestmark = pytest.mark.slow

ASSETS = Path(__file__).parents[3] / "compare/report/assets"
CHECK = "-p", "jsconfig.json", "--noEmit", "--pretty", "false"


def complaints(assets: Path, *more: str) -> list[str]:
    """Return the output of the checker for the modules in a folder."""
    checker = program("node-typescript", "tsc")
    return subprocess.run(
        [checker, *CHECK, *more], cwd=assets, capture_output=True, text=True, check=False
    ).stdout.splitlines()


def test_types_of_the_modules_are_right():
    lines = complaints(ASSETS, "--listFiles")
    modules = {Path(line).stem for line in lines if line.endswith(".js")}
    assert modules == set(MODULES)
    assert [line for line in lines if not line.endswith((".js", ".d.ts"))] == []


def test_a_type_error_is_found(tmp_path: Path):
    shutil.copytree(ASSETS, tmp_path, dirs_exist_ok=True)
    with (tmp_path / "modules/ticks.js").open("a") as module:
        module.write("figure('three');\n")
    (found,) = complaints(tmp_path)
    assert found.startswith("modules/ticks.js(")
    assert "'string' is not assignable to parameter of type 'number'" in found
