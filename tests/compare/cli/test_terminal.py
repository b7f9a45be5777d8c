"""Tables fit pipes and terminals, and poor or closed streams do no harm."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from slamgauge.compare.cli import terminal
from slamgauge.compare.cli.main import main
from tests.kernels import compile_kernels
from tests.reference import fast_commands

pytestmark = pytest.mark.slow

COMMAND = [sys.executable, "-m", "slamgauge"]
STUDY = ["study", "q1-short-dense", "--set", "trajectory.duration=1", "--runs", "2", "--jobs", "1"]
ESTIMATORS = ["--estimators", "dead-reckoning,ekf,causal,batch"]


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """A command whose runs are stored already."""
    compile_kernels()
    command = [*STUDY, *ESTIMATORS, "--out", str(tmp_path_factory.mktemp("study") / "out")]
    with fast_commands.studies_in_a_thread(), fast_commands.empty_pictures():
        assert main(command) == 0
    return command


def printed(capsys: pytest.CaptureFixture[str], *words: str) -> list[str]:
    capsys.readouterr()
    assert main([*words, "--no-report"]) == 0
    return capsys.readouterr().out.splitlines()


@pytest.mark.usefixtures("empty_pictures")
def test_tables_fit_pipes_and_terminals(
    study: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(terminal, "PIPED", 80)
    lines = printed(capsys, *study)
    assert max(map(len, lines)) <= 80
    head = re.split(r" {2,}", lines[0].strip())
    assert head == ["estimator", "runs", "ATE [m]", "x causal", "NEES/3", "in 95% ellipse"]
    assert lines[5].startswith("Hidden columns (show with --wide): NIS/dof, ")
    whole = printed(capsys, *study, "--wide")
    assert "mapped landmarks" in whole[0]
    assert not any("\x1b" in line for line in (*lines, *whole))
    monkeypatch.setattr(terminal.sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("COLUMNS", "250")
    assert "mapped landmarks" in printed(capsys, *study)[0]
    monkeypatch.setenv("COLUMNS", "60")  # no terminal is taken for narrower than 80
    assert len(printed(capsys, *study)[0]) > 60


def test_a_poor_encoding_and_no_home(study: list[str]):
    """A table has signs that ASCII lacks; matplotlib needs a home folder, and a progress bar a terminal."""
    poor = {"PYTHONIOENCODING": "ascii", "LANG": "C", "LC_ALL": "C", "HOME": "/nowhere", "TERM": ""}
    ended = subprocess.run([*COMMAND, *study], env=os.environ | poor, capture_output=True, check=False)
    assert (ended.returncode, b"Traceback" in ended.stderr, b"\\xb1" in ended.stdout) == (0, False, True)
    assert (Path(study[-1]) / "nees.png").exists()


@pytest.mark.parametrize("words", [["study", "--help"], ["scenarios"]])
def test_a_closed_pipe_is_not_an_error(words: list[str]):
    reading, writing = os.pipe()
    os.close(reading)
    ended = subprocess.run([*COMMAND, *words], stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert (ended.returncode, ended.stderr) == (0, "")
