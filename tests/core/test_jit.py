"""Compiled code is stored for its sources, read from folders that cannot be written, and can be switched off."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from unittest.mock import Mock

import pytest

from slamgauge import jit
from slamgauge.notices import tell_once
from tests.kernels import compile_kernels

STEP = """
import numpy as np
from slamgauge import Observations
from slamgauge.ekf import SlamFilter
for correction in ("standard", "right-invariant", "iterated"):
    slam = SlamFilter("range-bearing", np.zeros(3), np.diag([1e-2, 1e-2, 1e-4]), correction)
    for z in ([3.0, 0.1], [2.9, 0.1]):
        slam.predict([0.1, 0.0, 0.0], np.diag([1e-4, 0.0, 1e-6]))
        slam.update(Observations(np.array([4]), np.array([z]), np.diag([1e-2, 1e-3])[None]))
    print(*slam.pose.round(12), *slam.pose_cov.ravel().round(12), slam.map.cov.round(12).sum())
"""
SMALL_KERNEL = """
import numpy as np
from slamgauge.triangulation import triangulate
poses, bearings = np.array([[0.0, 0.0, 0.1], [1.0, 0.0, 0.2], [2.0, 0.1, 0.3]]), np.array([0.5, 0.6, 0.7])
found = triangulate(poses, bearings, np.full(3, 1e-3), 0.3)
print(*found.landmark.round(9), round(found.sigma, 9), found.placed)
"""


def run(code: str, **variables: str) -> tuple[list[str], str]:
    """Run a program; return its output lines and what it prints on standard error."""
    variables = {**os.environ, **variables}
    done = subprocess.run([sys.executable, "-c", code], env=variables, capture_output=True, text=True, check=True)
    return done.stdout.splitlines(), done.stderr


@pytest.mark.slow
def test_a_filter_step_compiled_or_not_compiled_gives_the_same() -> None:
    compile_kernels()
    plain, error = run(STEP, NUMBA_DISABLE_JIT="1")
    assert (len(plain), error) == (3, "")
    assert run(STEP) == (plain, "")


@pytest.mark.slow
def test_a_kernel_is_compiled_once_and_loaded_afterwards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The compilation prints one line. A folder that cannot be written to is copied."""
    plain, error = run(SMALL_KERNEL, NUMBA_DISABLE_JIT="1")
    assert (len(plain), error) == (1, "")
    assert run(SMALL_KERNEL, NUMBA_CACHE_DIR=str(tmp_path)) == (plain, f"slamgauge: {jit.FIRST_USE}\n")
    assert run(SMALL_KERNEL, NUMBA_CACHE_DIR=str(tmp_path)) == (plain, "")
    monkeypatch.setattr(jit.NUMBA, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "TemporaryFile", Mock(side_effect=PermissionError))
    found = jit.caches.__wrapped__()
    assert found is not None
    assert found != tmp_path
    assert {path.name for path in found.rglob("*.nbi")} == {path.name for path in tmp_path.rglob("*.nbi")}


@pytest.mark.usefixtures("no_notices_yet")
def test_without_a_folder_one_line_says_that_kernels_are_compiled_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(jit.NUMBA, "CACHE_DIR", str(tmp_path / "file"))
    monkeypatch.setattr(jit, "tell_once", tell_once)
    found = jit.caches.__wrapped__()
    assert found is not None
    assert not [*found.iterdir()]
    assert capsys.readouterr().err == f"slamgauge: {jit.NOT_STORED.format(jit.parent() / jit.digest())}\n"


def test_a_change_of_any_kernel_source_changes_the_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    before, read = jit.digest(), Path.read_bytes
    for name in ("se2.py", "blas.py", "elimination.py"):
        monkeypatch.setattr(Path, "read_bytes", lambda path, n=name: read(path) + b"#" * (path.name == n))
        assert jit.digest() != before
