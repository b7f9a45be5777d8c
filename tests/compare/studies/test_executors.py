"""Executors: errors of a Dask cluster are one line, and worker processes end with the command, however it ends."""

from __future__ import annotations

import logging
import math
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from distributed import Client, LocalCluster

from slamgauge.compare.studies import executors as cluster
from slamgauge.compare.studies.executors import dask_cluster, local_processes
from slamgauge.errors import UserError

pytestmark = pytest.mark.slow


SERVE = """
from distributed import LocalCluster
if __name__ == "__main__":
    cluster = LocalCluster(n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None)
    print(cluster.scheduler_address, flush=True)
    input()
"""


@pytest.mark.parametrize(
    ("workers", "theirs", "line"),
    [
        (0, {}, r"has no workers; start one: dask worker \S+"),
        (1, {"numpy": "1.0"}, r"worker tcp\S+ has numpy 1.0, and this is 2\S+; install the same on both sides"),
    ],
)
def test_workers_that_cannot_run_the_study(
    workers: int, theirs: dict[str, str | None], line: str, monkeypatch: pytest.MonkeyPatch
):
    get_versions = Client.get_versions

    def altered(client: Client, **options: Any) -> Any:
        found: Any = get_versions(client, **options)
        for each in found["workers"].values():
            each["packages"] |= theirs
        return found

    monkeypatch.setattr(cluster, "WORKERS", 30.0 if workers else 0.2)
    monkeypatch.setattr(Client, "get_versions", altered)
    options: dict[str, Any] = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": None}
    local: Any = LocalCluster(processes=False, protocol="tcp", **options)
    with local, pytest.raises(UserError, match=rf"^scheduler \S+: {line}$"):
        dask_cluster(local.scheduler_address).__enter__()


def test_a_scheduler_that_is_killed_is_one_line_within_seconds(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(cluster, "CONNECT", 3.0)
    client_log = logging.getLogger("distributed.client")
    with subprocess.Popen([sys.executable, "-c", SERVE], stdin=-1, stdout=-1, stderr=-3, text=True) as served:
        assert served.stdout is not None
        address, begun = served.stdout.readline().strip(), time.monotonic()
        line = r"^scheduler \S+: lost; start it again, and give the same command again$"
        with pytest.raises(UserError, match=line), dask_cluster(address) as executor:
            assert not client_log.isEnabledFor(logging.ERROR)  # its log sometimes repeats the error
            run = executor.submit(time.sleep, 60.0)
            served.kill()
            begun = time.monotonic()
            run.result()
        assert time.monotonic() - begun < 20.0
    assert capfd.readouterr().err == ""
    assert client_log.isEnabledFor(logging.ERROR)


def test_addresses_without_a_scheduler_are_refused_in_a_line(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(cluster, "CONNECT", 0.5)
    for address in ("tcp://127.0.0.1:1", "tls://127.0.0.1:1"):
        with pytest.raises(UserError, match=rf"^scheduler {address}: [^\n]*; give a running one$"):
            dask_cluster(address).__enter__()
    for text in ("nonsense", "ftp://127.0.0.1:1", "tcp://127.0.0.1:x", "127.0.0.1:8786", ""):
        line = f"^scheduler '{text}' is not an address; give tcp://host:port or tls://host:port$"
        with pytest.raises(UserError, match=line):
            dask_cluster(text).__enter__()


PROGRAM = """
import signal
import sys
import time
from slamgauge.compare.studies.executors import first_done, local_processes

def leave(number, frame):
    sys.exit(5)

if __name__ == "__main__":
    signal.signal(signal.SIGHUP, leave)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs inherit that it is ignored
    with local_processes(2) as pool:
        list(pool.map(time.sleep, [0.5, 0.5]))  # both have begun
        waiting = pool.submit(time.sleep, 1000.0)
        print("ready", flush=True)
        first_done([waiting])
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no process groups")
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
    assert not errors or ("KeyboardInterrupt" if end == "SIGINT" else "resource_tracker") in errors  # lines of Python


def leave(_: int) -> None:
    os._exit(1)


def answer_half(seconds: float) -> None:
    """Write the beginning of a result of 256 bytes, and end after a time."""
    os.write(sys._getframe(1).f_locals["pipe"].fileno(), (256).to_bytes(4) + b"half")
    time.sleep(seconds)
    os._exit(1)


def test_a_worker_that_dies_loses_only_its_own_run(monkeypatch: pytest.MonkeyPatch):
    start = SpawnProcess.start
    with local_processes(2) as executor:
        monkeypatch.setattr(SpawnProcess, "start", Mock(side_effect=OSError("no more processes")))
        refused = executor.submit(abs, -3).exception(60.0)
        monkeypatch.setattr(SpawnProcess, "start", start)
        calls: list[Callable[[int], object]] = [leave, math.sqrt, answer_half, abs]
        ended = [executor.submit(each, 0) for each in calls]
        errors = [each.exception(60.0) for each in ended]
    assert isinstance(refused, BrokenExecutor)
    assert [isinstance(each, BrokenExecutor) for each in errors] == [True, False, True, False]


def test_an_interrupt_waits_for_no_worker():
    """Neither for one that has written half a result: a killed one never writes the rest."""
    before = {*multiprocessing.active_children()}
    with pytest.raises(KeyboardInterrupt), local_processes(1) as executor:
        executor.submit(abs, 1).result(60.0)
        executor.submit(answer_half, 1000.0)
        time.sleep(0.5)
        raise KeyboardInterrupt
    assert {*multiprocessing.active_children()} <= before
