"""Shared by tests of the command line: a stored run, modules of user code, folders that refusals must not change."""

from __future__ import annotations

import itertools
import shutil
import sys
from pathlib import Path

import pytest

from tests.kernels import compile_kernels
from tests.reference.command_line import SHORT, Module, Refuse, run

NUMBERS = itertools.count()  # a process imports a module once, so that each needs a new name


@pytest.fixture(scope="package")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a short run of the shipped estimators, with seed 3."""
    compile_kernels()  # the first compilation prints a note on standard error
    folder = tmp_path_factory.mktemp("stored") / "run"
    assert run("run", "q1-long-sparse", "--set", *SHORT, "--seed", 3, "--out", folder) == 0
    return folder


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Module:
    """Writes source code to a module in the current folder and returns its import name."""
    folder = tmp_path / "code"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", [*sys.path])

    def write(source: str) -> str:
        name = f"own_{next(NUMBERS)}"
        (folder / f"{name}.py").write_text(source, encoding="utf-8")
        return name

    return write


@pytest.fixture(params=["new folder", "older results"])
def refuse(request: pytest.FixtureRequest, tmp_path: Path, stored: Path, capsys: pytest.CaptureFixture[str]) -> Refuse:
    """Run a refused command with a new folder, and with one that has the results of a run."""
    out = tmp_path / "results/run"
    out.parent.mkdir()
    if request.param == "older results":
        shutil.copytree(stored, out)
    return Refuse(out, capsys)
