"""A full disk, Ctrl-C and SIGTERM lose no finished result, and leave no half-written folder."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from slamgauge.compare.cli.doctor import WARM_UPS, run_shortly
from slamgauge.compare.storage.staged_folder import MARK
from slamgauge.compare.studies.study import load_runs
from slamgauge.errors import UserError
from tests.marks import in_full
from tests.reference.command_line import command_after, contents

pytestmark = pytest.mark.slow


@pytest.fixture(params=["new folder", "older results"])
def out(request: pytest.FixtureRequest, tmp_path: Path, stored: Path) -> Path:
    """A folder that does not exist yet, and one with the results of a run."""
    folder = tmp_path / "results/run"
    folder.parent.mkdir()
    if request.param == "older results":
        shutil.copytree(stored, folder)
    return folder


def evaluate_with_room(stored: Path, out: Path, room: int) -> subprocess.CompletedProcess[str]:
    """Run a command that may write `room` bytes into a file."""
    unwritten = "import sys; sys.dont_write_bytecode = True"  # Python would keep truncated files
    limit = f"{unwritten}; import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({room}, {room}))"
    arguments = ("evaluate", stored / "recording.npz", "--estimators", "dead-reckoning", "--no-report", "--out", out)
    return subprocess.run(command_after(limit, *arguments), capture_output=True, text=True, check=False)


def test_a_disk_that_is_full_costs_the_folder_but_not_the_table(stored: Path, out: Path):
    before = contents(out.parent)
    done = evaluate_with_room(stored, out, 2_000)
    assert (done.returncode, done.stdout.split()[0]) == (2, "estimator")
    assert re.fullmatch(r"slamgauge: \S+: cannot be written \(File too large\); check .*\n", done.stderr)
    assert contents(out.parent) == before


@pytest.mark.parametrize("out", ["new folder", *in_full(["older results"])], indirect=True)
def test_a_disk_that_fills_up_at_the_figure_costs_that_alone(stored: Path, out: Path):
    done = evaluate_with_room(stored, out, 100_000)
    assert (done.returncode, done.stdout.split()[0]) == (1, "estimator")
    lost, written = done.stderr.splitlines()
    expected = rf"slamgauge: {out}/figure: not written \(OSError: .*too large.*all other files are written"
    assert re.fullmatch(expected, lost)
    assert written == f"written to {out}"
    assert {path.name for path in out.iterdir()} == {
        *("recording.npz", "truth.npz", "metrics.json", "estimates", "trajectories", MARK)
    }


def signalled(number: int, happened: Callable[[], bool], *arguments: object) -> tuple[int, str, str]:
    """Send a signal to a command half a second after something has happened; return its status and output."""
    # pytest may run in the background, where interrupts are ignored
    heed = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(command_after(heed, *arguments), **pipes, text=True)
    try:
        while not happened():
            assert process.poll() is None
            time.sleep(0.02)
        time.sleep(0.5)
        process.send_signal(number)
        out, err = process.communicate()
    finally:
        process.kill()
    return process.returncode, out, err


INTERRUPTED = "slamgauge: interrupted; the same command runs again, a study from its finished runs on\n"


@pytest.mark.parametrize(
    ("out", "number", "status"),
    [("new folder", signal.SIGINT, 130), ("older results", signal.SIGTERM, 143), ("older results", signal.SIGHUP, 129)],
    indirect=["out"],
)
def test_a_run_that_is_interrupted_or_terminated_leaves_nothing_behind(out: Path, number: int, status: int):
    before = contents(out.parent)
    run_shortly(*WARM_UPS["graph"])  # compilation sometimes swallows an interrupt
    words = ("run", "q1-long-dense", "--set", "trajectory.duration=500", "--estimators", "causal", "--out", out)
    ended = signalled(number, lambda: contents(out.parent) != before, *words)  # the staging folder exists
    assert ended == (status, "", INTERRUPTED)
    assert contents(out.parent) == before


@pytest.mark.parametrize("number", [signal.SIGINT, *in_full([signal.SIGTERM])])  # a run has both
def test_a_study_that_is_interrupted_keeps_its_finished_runs(tmp_path: Path, number: int):
    words = ("study", "q1-short-dense", "--runs", 10_000, "--jobs", 1, "--estimators", "dead-reckoning")

    def stored() -> int:
        with suppress(UserError):  # the store does not exist yet
            return len(load_runs("q1-short-dense", 10_000, 0, ["dead-reckoning"], tmp_path / "study").popitem()[1].run)
        return 0

    status, printed, err = signalled(number, lambda: stored() > 0, *words, "--out", tmp_path / "study")
    assert (status, printed, err.splitlines(keepends=True)[-1]) == (128 + number, "", INTERRUPTED)
    assert stored() > 0
    assert {path.name for path in (tmp_path / "study").iterdir()} <= {MARK, "study.sqlite", "study.sqlite-lock"}
