"""Worker processes of this machine end with the command, however it ends, and without a word."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.skipif(sys.platform == "win32", reason="Windows has no process groups"), pytest.mark.slow]

PROGRAM = """
import signal
import sys
import time
from slamgauge.compare.studies.executors import local_processes

def leave(number, frame):
    sys.exit(5)

if __name__ == "__main__":
    signal.signal(signal.SIGHUP, leave)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs inherit that it is ignored
    with local_processes(2) as pool:
        pool.submit(abs, 1).result()
        waiting = pool.submit(time.sleep, 1000.0)
        print("ready", flush=True)
        waiting.result()
"""


@pytest.mark.parametrize(("end", "status"), [("SIGINT", -2), ("SIGTERM", -15), ("SIGKILL", -9), ("SIGHUP", 5)])
def test_processes_end_with_the_command(end: str, status: int, tmp_path: Path):
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    process = subprocess.Popen(
        [sys.executable, program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    send = os.killpg if end == "SIGHUP" else os.kill  # a closed terminal ends the whole group
    send(process.pid, getattr(signal, end))
    _, errors = process.communicate(timeout=60.0)  # both pipes are closed when the last process has ended
    assert process.returncode == status
    assert not errors or end == "SIGINT"  # then Python prints the line that it interrupted
