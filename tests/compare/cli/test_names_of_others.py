"""Files of others that are called as our folders are, on the path and in the current folder: no command meets them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from slamgauge.ekf.kernels.warm_up import compile_once

NAMES = ("ekf", "compare", "slam2d", "graph_baseline", "slamgauge_test", "benchmarks", "examples")
SHORT = ("--set", "trajectory.duration=3")


@pytest.fixture(scope="module", autouse=True)
def compiled_kernels() -> None:
    compile_once()


@pytest.fixture
def nonsense(tmp_path: Path) -> Path:
    folder = tmp_path / "nonsense"
    folder.mkdir()
    for name in NAMES:
        (folder / f"{name}.py").write_text(f"raise SystemExit('{name}.py is not ours')\n", encoding="utf-8")
    return folder


def run(folder: Path, *arguments: str) -> str:
    """What `python ARGUMENTS` prints where those files are, and first on the path."""
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "is not ours" not in done.stderr
    return done.stdout


def test_the_files_are_met_by_whoever_asks_for_them(nonsense: Path):
    with pytest.raises(AssertionError, match=r"ekf\.py is not ours"):
        run(nonsense, "-c", "import ekf")


def test_a_run_meets_none(nonsense: Path):
    names = "dead-reckoning,ekf,riekf,causal,batch,causal@ekf"
    printed = run(nonsense, "-m", "slamgauge", "run", "q2-short-dense", "--estimators", names, *SHORT, "--json")
    assert list(json.loads(printed)["estimators"]) == names.split(",")


def test_the_workers_of_a_study_meet_none(nonsense: Path):
    size = ("--runs", "2", "--jobs", "2", "--estimators", "ekf,causal", "--out", "study")
    run(nonsense, "-m", "slamgauge", "study", "q1-short-dense", *size, *SHORT)
    summary = json.loads((nonsense / "study/summary.json").read_text(encoding="utf-8"))
    assert (summary["runs"], summary["failures"]) == (2, [])


def test_the_public_names_are_ours(nonsense: Path):
    program = (
        "import slamgauge as s; print(*(getattr(s, name).__name__ for name in ('ekf', 'compare', 'graph_baseline')))"
    )
    assert run(nonsense, "-c", program).split() == ["slamgauge.ekf", "slamgauge.compare", "slamgauge.graph_baseline"]
