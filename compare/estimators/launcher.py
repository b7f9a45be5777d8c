"""A process without user code that forks one with user code for every run: `python -P -m … KIND SOCKET`.

It imports slamgauge and the libraries that the code imports, and compiles the code, once. So a run starts within
milliseconds, in a process that nothing has touched. Standard input is the settings: a line of JSON. Each request on
the socket brings three open files (requests, answers, output) for a new process; the request after it ends the
process, and is answered with its status. The end of the socket ends everything.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import resource
import shutil
import signal
import socket
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from time import monotonic, sleep
from typing import cast

from slamgauge.compare.estimators import isolated_worker, namespaces, wall
from slamgauge.compare.estimators.answers import address_of
from slamgauge.compare.estimators.fresh_modules import prepare
from slamgauge.compare.estimators.isolated_worker import MOST_MEMORY, leave, limit, serve
from slamgauge.compare.estimators.launched_process import END, START, STILL_RUNS, WHY

FOLDERS = "slamgauge-own-"  # prefix of the temporary folders without a wall
MOST_FILES = 4096
FILES = 3  # open files that a request to start brings
SOON = 0.2  # s: time for a process that has answered to end; the system adds its processor time to ours
LATER = 5.0  # s: time for a process that has closed its answers to end
COMPILING = 60  # s: time to compile the code, before the system ends this process
LEAVING = 1.0  # s: time for a process without a wall to end the programs that it has started


def main(kind: wall.Kind, requests: socket.socket) -> None:
    """Serve requests until the socket is closed."""
    settings = json.loads(sys.stdin.readline())
    seen = wall.view(**settings["view"])
    with suppress(OSError):  # if the machine runs out of memory, the system ends processes with user code first
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")
    if sys.platform.startswith("linux"):
        limit(resource.RLIMIT_DATA, MOST_MEMORY)
    if kind != "bwrap":  # bwrap starts interpreters
        import_installed(settings["imports"])
        if (sources := address_of(settings["address"]).sources) is not None:
            signal.alarm(COMPILING)
            prepare(sources)
            signal.alarm(0)
    gc.freeze()  # forked processes then copy fewer pages
    while True:
        _, files, _, _ = socket.recv_fds(requests, len(START), FILES)
        if len(files) != FILES:
            return
        home = tempfile.mkdtemp(prefix=FOLDERS) if kind == "none" else wall.HOME
        pid = _started(kind, seen, files, home)
        for each in files:
            os.close(each)
        seconds = LATER if requests.recv(len(END)) == WHY else SOON
        status = _end(pid, seconds, patient=kind == "none")
        if kind == "none":
            shutil.rmtree(home, ignore_errors=True)
        with suppress(OSError):  # slamgauge has ended
            requests.send(bytes([status]))


def _started(kind: wall.Kind, seen: wall.View, files: Sequence[int], home: str) -> int:
    """Fork a process with user code behind its wall; return the number of the leader of its group."""
    requests, answers, output = files

    def work() -> None:
        _close_all_but(requests, answers)
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
        _close_all_but(requests, answers)
        for each in (requests, answers):
            os.set_inheritable(each, True)
        program = [sys.executable, "-P", "-m", isolated_worker.__name__, str(requests), str(answers)]
        command = [*wall.bwrap_command(seen), *program]
        os.execv(command[0], command)

    if kind == "namespaces":
        return namespaces.forked_apart(behind_namespaces, output)
    return namespaces.forked(behind_bwrap if kind == "bwrap" else work, output)


def _close_all_but(*files: int) -> None:
    """Close all files but these and the standard ones, above all the socket of the launcher."""
    kept = [2, *sorted(files), MOST_FILES]
    for before, after in pairwise(kept):
        os.closerange(before + 1, after)


def _end(pid: int, seconds: float, *, patient: bool) -> int:
    """End a process and its group; return its status if it ends without that in the time, else `STILL_RUNS`.

    A patient end gives it time for programs with groups of their own.
    """
    status = own = _awaited(pid, seconds)
    if status is None and patient:
        os.kill(pid, signal.SIGTERM)
        status = _awaited(pid, LEAVING)
    with suppress(ProcessLookupError, PermissionError):  # the group is empty
        os.killpg(pid, signal.SIGKILL)
    if status is None:
        os.waitpid(pid, 0)
    return STILL_RUNS if own is None else own


def _awaited(pid: int, seconds: float) -> int | None:
    """Return the status of a process that ends in the time, as shells do; None if it still runs."""
    deadline = monotonic() + seconds
    while monotonic() < deadline:
        ended, status = os.waitpid(pid, os.WNOHANG)
        if ended:
            code = os.waitstatus_to_exitcode(status)
            return code if code >= 0 else namespaces.SIGNALLED - code
        sleep(0.002)
    return None


def import_installed(names: Sequence[str]) -> None:
    """Import installed modules, and attributes like `slamgauge.batch` that an import loads.

    A module outside the folders of libraries may be user code (`PYTHONPATH`), which never runs here, and neither do
    programs: `__main__` of packages, and Python's own modules, of which some begin something when they are imported.
    """
    for name in filter(_is_installed, names):
        with suppress(Exception):  # an error that the user's import shows
            importlib.import_module(name)
            continue
        with suppress(Exception):
            module, _, attribute = name.rpartition(".")
            getattr(importlib.import_module(module), attribute, None)


def _is_installed(name: str) -> bool:
    """Return whether a module belongs to slamgauge, or is not a program and lies in a folder of libraries."""
    top = name.partition(".")[0]
    if "__main__" in name.split(".") or top in sys.stdlib_module_names:
        return False
    with suppress(ImportError, ValueError):
        spec = find_spec(top)
        folders = [sysconfig.get_path(each) for each in ("purelib", "platlib")]
        return spec is not None and (top == "slamgauge" or str(spec.origin).startswith(tuple(f"{f}/" for f in folders)))
    return False


if __name__ == "__main__":
    main(cast("wall.Kind", sys.argv[1]), socket.socket(fileno=int(sys.argv[2])))
