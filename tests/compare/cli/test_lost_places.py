"""The command line: folders that cannot be written, disks that are full, and interrupts."""

from __future__ import annotations

import re
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from slamgauge.compare.cli.doctor import WARM_UPS, run_shortly
from slamgauge.compare.storage.staged_folder import MARK
from tests.reference.command_line import Refuse, command_after, contents

pytestmark = pytest.mark.slow


def evaluate_with_room(stored: Path, out: Path, room: int) -> subprocess.CompletedProcess[str]:
    """Run a command that may write `room` bytes into a file."""
    unwritten = "import sys; sys.dont_write_bytecode = True"  # Python would keep truncated files
    limit = f"{unwritten}; import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({room}, {room}))"
    arguments = ("evaluate", stored / "recording.npz", "--estimators", "dead-reckoning", "--no-report", "--out", out)
    return subprocess.run(command_after(limit, *arguments), capture_output=True, text=True, check=False)


def test_a_disk_that_is_full_costs_the_folder_but_not_the_table(stored: Path, refuse: Refuse):
    before = contents(refuse.out.parent)
    done = evaluate_with_room(stored, refuse.out, 2_000)
    assert (done.returncode, done.stdout.split()[0]) == (2, "estimator")
    assert re.fullmatch(r"slamgauge: \S+: cannot be written \(File too large\); check .*\n", done.stderr)
    assert contents(refuse.out.parent) == before


def test_a_disk_that_fills_up_at_the_figure_costs_that_alone(stored: Path, refuse: Refuse):
    done = evaluate_with_room(stored, refuse.out, 100_000)
    assert (done.returncode, done.stdout.split()[0]) == (1, "estimator")
    lost, written = done.stderr.splitlines()
    expected = rf"slamgauge: {refuse.out}/figure: not written \(OSError: .*too large.*all other files are written"
    assert re.fullmatch(expected, lost)
    assert written == f"written to {refuse.out}"
    assert {path.name for path in refuse.out.iterdir()} == {
        *("recording.npz", "truth.npz", "metrics.json", "estimates", "trajectories", MARK)
    }


@pytest.mark.parametrize(
    ("refuse", "number", "status"),
    [
        ("new folder", signal.SIGINT, 130),
        ("older results", signal.SIGINT, 130),
        pytest.param("new folder", signal.SIGTERM, 143, marks=pytest.mark.full),
        ("older results", signal.SIGHUP, 129),
    ],
    indirect=["refuse"],
)
def test_a_run_that_is_interrupted_or_terminated_leaves_nothing_behind(refuse: Refuse, number: int, status: int):
    before = contents(refuse.out.parent)
    run_shortly(*WARM_UPS["graph"])  # compilation sometimes swallows an interrupt
    arguments = ("q1-long-dense", "--set", "trajectory.duration=500", "--estimators", "causal", "--out", refuse.out)
    # pytest may run in the background, where interrupts are ignored
    heed = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    process = subprocess.Popen(
        command_after(heed, "run", *arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        wait_for(lambda: contents(refuse.out.parent) != before)  # until the staging folder exists
        time.sleep(0.5)  # `causal` now runs, for many seconds
        process.send_signal(number)
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
    assert (process.returncode, out, err) == (status, "", "slamgauge: interrupted; nothing was written\n")
    assert contents(refuse.out.parent) == before


def wait_for(happened: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < end
        time.sleep(0.02)
