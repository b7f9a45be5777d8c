"""Commands whose standard streams are closed, full, or poor in characters: results are written, and no traceback."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from slamgauge.ekf.kernels.warm_up import compile_once

SHORT = ("--set", "trajectory.duration=1")
RUN = ("run", "q1-short-dense", *SHORT, "--estimators", "ekf", "--out", "out")
STUDY = ("study", "q1-short-dense", *SHORT, "--estimators", "ekf", "--runs", "2", "--jobs", "1", "--out", "out")

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")


@pytest.fixture(scope="module", autouse=True)
def compiled_kernels() -> None:
    compile_once()


def in_shell(
    folder: Path, redirection: str, *words: str, environment: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """A command as a shell starts it, with its streams redirected."""
    given = {**os.environ, "PATH": os.defpath, **(environment or {})}
    command = ["sh", "-c", f'"$@" {redirection}', "sh", sys.executable, "-m", "slamgauge", *words]
    return subprocess.run(command, cwd=folder, env=given, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("redirection", "status", "said"),
    [
        ("2>&-", 0, ""),
        ("<&- >&- 2>&-", 0, ""),
        (">/dev/full", 1, "slamgauge: standard output: cannot be written (No space left on device); give it room\n"),
        (">/dev/full 2>&1", 1, ""),
    ],
)
def test_streams_that_take_nothing_cost_no_results(tmp_path: Path, redirection: str, status: int, said: str):
    done = in_shell(tmp_path, redirection, *RUN)
    talk = "" if "2>" in redirection else f"{said}written to out\n"
    assert (done.returncode, done.stderr) == (status, talk)
    assert (tmp_path / "out/metrics.json").exists()
    assert (tmp_path / "out/figure.png").exists()
    if ">&-" not in redirection.replace("2>&-", "") and "/dev/full" not in redirection.replace("2>/dev/full", ""):
        assert done.stdout.startswith("estimator")
        assert "written to" not in done.stdout


def test_a_reader_who_has_seen_enough(tmp_path: Path):
    done = in_shell(tmp_path, "| true", *RUN)
    assert done.stderr == "written to out\n"
    assert (tmp_path / "out/metrics.json").exists()


def test_a_poor_encoding_and_no_home(tmp_path: Path):
    """A table has signs that ASCII lacks; a progress bar and matplotlib look for a terminal, and for a home."""
    poor = {"PYTHONIOENCODING": "ascii", "LANG": "C", "LC_ALL": "C", "HOME": "/nowhere", "TERM": ""}
    done = in_shell(tmp_path, "", *STUDY, environment=poor)
    assert done.returncode == 0
    assert "\\xb1" in done.stdout
    assert "Traceback" not in done.stderr
    assert {"summary.json", "nees.png"} < {path.name for path in (tmp_path / "out").iterdir()}


@pytest.mark.parametrize("words", [("--help",), ("run", "--help"), ("--version",)])
def test_help_that_finds_no_room_is_a_line(tmp_path: Path, words: tuple[str, ...]):
    done = in_shell(tmp_path, ">/dev/full", *words)
    assert done.returncode in (1, 71)
    assert re.fullmatch(r"slamgauge: [^\n]*No space left on device[^\n]*\n", done.stderr)
