"""Worker processes of this machine end with the command, however it ends, and without a word."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = [pytest.mark.skipif(sys.platform == "win32", reason="Windows has no process groups"), pytest.mark.slow]

PROGRAM = """
import signal, sys, time
from slamgauge.compare.studies.executors import local_processes

def leave(number, frame):
    sys.exit(5)

if __name__ == "__main__":
    signal.signal(signal.SIGHUP, leave)
    with local_processes(2) as pool:
        pool.submit(abs, 1).result()
        waiting = pool.submit(time.sleep, 1000.0)
        print("ready", flush=True)
        waiting.result()
"""


def terminal_closed(pid: int) -> None:
    os.killpg(pid, signal.SIGHUP)


def killed(pid: int) -> None:
    os.kill(pid, signal.SIGKILL)


@pytest.mark.parametrize(("end", "status"), [(terminal_closed, 5), (killed, -9)])
def test_processes_end_without_a_word(end: Callable[[int], None], status: int, tmp_path: Path):
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    process = subprocess.Popen(
        [sys.executable, program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    end(process.pid)
    _, errors = process.communicate(timeout=60.0)  # both pipes are closed when the last process has ended
    assert process.returncode == status
    assert errors == ""
