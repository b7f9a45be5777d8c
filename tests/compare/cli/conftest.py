"""A stored run, shared by tests of the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.kernels import compile_kernels
from tests.reference.command_line import SHORT, run


@pytest.fixture(scope="package")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a short run of the shipped estimators, with seed 3."""
    compile_kernels()  # the first compilation prints a note on standard error
    folder = tmp_path_factory.mktemp("stored") / "run"
    assert run("run", "q1-long-sparse", "--set", *SHORT, "--seed", 3, "--out", folder) == 0
    return folder
