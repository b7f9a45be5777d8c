"""Inputs that would block, fill the memory or end in a traceback are refused in one line."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from slamgauge.compare.cli.main import REFUSED, main
from slamgauge.errors import refused_by_the_machine
from tests.reference.command_line import command_after

pytestmark = pytest.mark.slow

POINTS = 'trajectory={kind="waypoints",points=[[0,0],[0,0]],speed=1,yaw_rate=1,step=0.1}'


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["import", "csv", ""], "'' is an empty path"),
        (["run", "tp4-handout", "--timeout", "2147484"], "leaves no time, or sets no limit"),
        (["run", "tp4-handout", "--set", POINTS], "trajectory.points: all are at the start"),
        (["run", "tp4-handout", "--set", "prior.mean=[1e15,0,0]"], "prior.mean[0]: must be from 0 to 1e+09 m"),
        (["run", "tp4-handout", "--set", "sensor.sigma_range=1e-300"], "sensor.sigma_range: must be from 1e-12"),
        (["run", "tp4-handout", "--set", "motion.sigma_speed=1e10"], "motion.sigma_speed: must be from 1e-12"),
        (["run", "tp4-handout", "--set", "motion.sigma_speed=1e3"], "motion.sigma_speed: a step of 0.1 s has"),
        (["run", "tp4-handout", "--set", "motion.sigma_lateral=101"], "motion.sigma_lateral: a step of 0.1 s has"),
        (["run", "tp4-handout", "--estimators", "fixed-lag-1000000000"], "write fixed-lag-N with a number N"),
    ],
)
def test_an_input_is_refused_in_one_line(
    words: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    assert main([*words, *(["--out", "o"] if words[0] != "evaluate" else [])]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert message in lines[-1]
    assert not Path("o").exists()


def test_a_scenario_may_begin_with_a_byte_order_mark(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "mark.toml").write_bytes(b"\xef\xbb\xbfextends = 'tp4-handout'\nmark = 1\n")
    assert main(["run", str(tmp_path / "mark.toml"), "--out", str(tmp_path / "o")]) == 2
    assert "mark.toml: mark: unknown key" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not limit the address space")
def test_too_little_memory_for_the_libraries_is_one_line_that_names_the_limit():
    limit = "import resource; resource.setrlimit(resource.RLIMIT_AS, (300_000_000, 300_000_000))"
    words = command_after(limit, "run", "q1-short-dense", "--estimators", "dead-reckoning", "--out", "nowhere")
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == REFUSED
    assert re.fullmatch(r"slamgauge: the machine refused: [^\n]*`ulimit -v`[^\n]*make room[^\n]*\n", done.stderr)


@pytest.mark.parametrize("text", ["x.so: failed to map segment from shared object", "no module named x"])
def test_a_library_that_does_not_fit_into_memory_is_no_defect(text: str):
    assert refused_by_the_machine(ImportError(text)) == ("map segment" in text)
