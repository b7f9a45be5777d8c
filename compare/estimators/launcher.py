"""A process without user code that forks one with user code for every run: `python -P -m … KIND SOCKET`.

It imports slamgauge and the libraries that the code imports once, so that a run starts within milliseconds, in a
process that nothing has touched. Standard input is the settings: a line of JSON. Each request on the socket brings
three open files (requests, answers, output) for a new process; the request after it ends the process, and is answered
with its status. The end of the socket ends everything.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import shutil
import signal
import socket
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep
from typing import cast

from slamgauge.compare.estimators import isolated_worker, namespaces, wall
from slamgauge.compare.estimators.isolated_worker import leave, serve

PROGRAM = "slamgauge.compare.estimators.launcher"
FOLDERS = "slamgauge-own-"  # prefix of the temporary folders without a wall
START, END, WHY = b"+", b"-", b"?"  # requests
FILES = 3  # open files that a request to start brings
SOON = 0.2  # s: time for a process that has answered to end; the system adds its processor time to ours
LATER = 5.0  # s: time for a process that has closed its answers to end
LEAVING = 1.0  # s: time for a process without a wall to end the programs that it has started
STILL_RUNS = 255  # status of a process that had to be ended


def main(kind: wall.Kind, requests: socket.socket) -> None:
    """Serve requests until the socket is closed."""
    settings = json.loads(sys.stdin.readline())
    seen = wall.view(**settings["view"])
    with suppress(OSError):  # if the machine runs out of memory, the system ends processes with user code first
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")
    if kind != "bwrap":  # which starts interpreters
        _import(settings["imports"])
    gc.freeze()  # forked processes then copy fewer pages
    while True:
        _, files, _, _ = socket.recv_fds(requests, len(START), FILES)
        if len(files) != FILES:
            return
        home = tempfile.mkdtemp(prefix=FOLDERS) if kind == "none" else wall.HOME
        pid = _started(kind, seen, files, home)
        for each in files:
            os.close(each)
        status = _ended(pid, LATER if requests.recv(len(END)) == WHY else SOON)
        _end(pid, patient=kind == "none")
        if kind == "none":
            shutil.rmtree(home, ignore_errors=True)
        with suppress(OSError):  # slamgauge has ended
            requests.send(bytes([status]))


def _started(kind: wall.Kind, seen: wall.View, files: Sequence[int], home: str) -> int:
    """Fork a process with user code behind its wall; return the number of the leader of its group."""
    requests, answers, output = files

    def work() -> None:
        signal.signal(signal.SIGTERM, leave)
        with suppress(KeyboardInterrupt):
            serve(requests, answers, home, walled=kind != "none")

    def behind_namespaces() -> None:
        wall.enter(seen)
        user = os.fork()
        if not user:
            os.setsid()  # `kill(0)` reaches no process outside
            namespaces.work_and_end(work)
        namespaces.end_with(user)

    def behind_bwrap() -> None:
        for each in (requests, answers):
            os.set_inheritable(each, True)
        program = [sys.executable, "-P", "-m", isolated_worker.__name__, str(requests), str(answers)]
        command = [*wall.bwrap_command(seen), *program]
        os.execv(command[0], command)

    if kind == "namespaces":
        return namespaces.forked_apart(behind_namespaces, output)
    return namespaces.forked(behind_bwrap if kind == "bwrap" else work, output)


def _ended(pid: int, seconds: float) -> int:
    """Wait for the end of a process; return its status, or that it still runs, without forgetting the process."""
    deadline = monotonic() + seconds
    while monotonic() < deadline:
        ended = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        if ended is not None:
            return ended.si_status + (0 if ended.si_code == os.CLD_EXITED else namespaces.SIGNALLED)
        sleep(0.002)
    return STILL_RUNS


def _end(pid: int, *, patient: bool) -> None:
    """End a process and its group; a patient end gives it time for programs with groups of their own."""
    if patient:
        os.kill(pid, signal.SIGTERM)
        _ended(pid, LEAVING)
    with suppress(ProcessLookupError, PermissionError):  # the group is empty
        os.killpg(pid, signal.SIGKILL)
    os.waitpid(pid, 0)


def _import(names: Sequence[str]) -> None:
    """Import installed modules, and attributes like `slamgauge.batch` that an import loads."""
    for name in names:
        module, _, attribute = name.rpartition(".")
        with suppress(Exception):  # a name of the user's own modules, or an error that the user's import shows
            if not module or attribute == "*":
                importlib.import_module(module or name)
            else:
                getattr(importlib.import_module(module), attribute)
                continue
        with suppress(Exception):
            importlib.import_module(name)


if __name__ == "__main__":
    main(cast("wall.Kind", sys.argv[1]), socket.socket(fileno=int(sys.argv[2])))
