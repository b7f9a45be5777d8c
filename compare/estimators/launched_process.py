"""Processes with user code, and the pipes to them: requests and answers, and what the code prints.

Output is read as it comes, and only the end is kept. Too much output, too long a run and the end of the process are
errors of one line.
"""

from __future__ import annotations

import json
import os
import signal
import site
import socket
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from selectors import EVENT_READ, EVENT_WRITE, DefaultSelector
from time import monotonic

from slamgauge.compare.estimators import namespaces
from slamgauge.compare.estimators.answers import Answer, Incoming, address_fields, printable
from slamgauge.compare.estimators.sources import Sources, added_folders, imported_names
from slamgauge.compare.estimators.user_code import Address, OverdueError, UserCodeError
from slamgauge.compare.estimators.wall import caches, kind_of_wall, require_wall

PROGRAM = "slamgauge.compare.estimators.launcher"
START, END, WHY = b"+", b"-", b"?"  # requests to the launcher
STILL_RUNS = 255  # status of a process that had to be ended
NO_LAUNCHER = 254  # status of a process whose launcher has ended
MOST_PRINTED = 10_000_000  # bytes of output in a run
TAIL = 4000  # bytes of output that are kept

KEPT = ("PATH", "PYTHONPATH", "VIRTUAL_ENV", "CONDA_PREFIX", "LANG", "LANGUAGE", "TZ", "SSL_CERT_FILE")
KEPT_BEGINNINGS = ("LC_", "LD_", "DYLD_", "NUMBA_", "OPENBLAS_", "MKL_", "OMP_", "KMP_", "VECLIB_")


class Launcher:
    """The process that forks those with user code."""

    def __init__(self, where: Address, *, unconfined: bool) -> None:
        require_wall(unconfined=unconfined)
        self.requests, theirs = socket.socketpair()
        kind = "none" if unconfined else kind_of_wall()
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", PROGRAM, kind, str(theirs.fileno())],
            cwd=tempfile.gettempdir(),
            env=environment(os.environ),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(theirs.fileno(),),
            start_new_session=True,
        )
        theirs.close()
        self.end = weakref.finalize(self, _end, self._process, self.requests)
        assert self._process.stdin is not None
        with suppress(BrokenPipeError), self._process.stdin as settings:  # `Process` reports that it has ended
            settings.write(json.dumps(_settings(where)).encode() + b"\n")


def _settings(where: Address) -> dict[str, object]:
    """Return what the launcher imports and shows."""
    sources = where.sources or Sources("", "", ())
    folder = Path(sources.folder)
    added = {each for _, content in sources.files for each in added_folders(folder, content, sources.top)}
    names = sorted({name for _, content in sources.files for name in imported_names(content)})
    neighbours = [path for path, _ in sources.files]
    shown = {"folder": sources.folder, "neighbours": neighbours, "added": sorted(added), "strangers": where.strangers}
    return {"view": shown, "imports": names, "address": address_fields(where)}


def _end(process: subprocess.Popen[bytes], requests: socket.socket) -> None:
    """End the launcher, which ends the processes that it has forked."""
    requests.close()
    process.wait()


class Process:
    """A process with user code, and the pipes to it. A launcher has one at a time."""

    def __init__(self, launcher: Launcher) -> None:
        self._launcher = launcher
        (theirs, self._requests), (self._answers, answers), (self._output, output) = os.pipe(), os.pipe(), os.pipe()
        for each in (self._requests, self._output):
            os.set_blocking(each, False)
        with suppress(BrokenPipeError):  # `exchange` reports that the launcher has ended
            socket.send_fds(launcher.requests, [START], [theirs, answers, output])
        for each in (theirs, answers, output):
            os.close(each)
        self._incoming, self._tail = Incoming(), b""
        self._status: int | None = None  # after its end

    def exchange(self, request: bytes, seconds: float) -> Answer:
        """Write a request, and read the answer and meanwhile the output.

        Raises:
            UserCodeError: it printed too much, has ended, or wrote a wrong answer.
            OverdueError: it did not answer in time.
        """
        deadline, printed, answer = monotonic() + seconds, 0, self._incoming.add(b"")
        with DefaultSelector() as selector:
            for each in (self._answers, self._output):
                selector.register(each, EVENT_READ)
            if request:
                selector.register(self._requests, EVENT_WRITE)
            while answer is None or request:  # the process may answer before it has read the whole request
                left = deadline - monotonic()
                if left <= 0:
                    remedy = "make it faster, or give a longer --timeout"
                    raise OverdueError(f"it was not done after {seconds:g} s; {remedy}{self._last_line()}")
                for key, _ in selector.select(left):
                    if key.fd == self._requests:
                        request = self._write(request)
                        if not request:
                            selector.unregister(key.fd)
                        continue
                    data = os.read(key.fd, 1 << 20)
                    if key.fd == self._answers:
                        if not data:
                            raise UserCodeError(self._why_no_answer())
                        answer = self._incoming.add(data)
                    elif data:
                        printed += len(data)
                        self._tail = (self._tail + data)[-TAIL:]
                        if printed > MOST_PRINTED:
                            what = f"it printed more than {MOST_PRINTED / 1e6:g} MB in a run"
                            raise UserCodeError(f"{what}; take the prints out{self._last_line()}")
                    else:
                        selector.unregister(key.fd)
        return answer

    def end(self) -> None:
        """End the process and all that it has started, and close the pipes."""
        self._end(END)
        self._read_rest()
        for each in (self._requests, self._answers, self._output):
            os.close(each)

    def _end(self, request: bytes) -> int:
        """End the process; return its status."""
        if self._status is None:
            self._status = NO_LAUNCHER
            with suppress(OSError):  # the launcher has ended
                self._launcher.requests.sendall(request)
                self._status = ord(self._launcher.requests.recv(1) or bytes([NO_LAUNCHER]))
        return self._status

    @property
    def last_lines(self) -> list[str]:
        """The last lines of its output, at most 20."""
        lines = self._tail.decode("utf-8", errors="replace").splitlines()
        return [printable(line) for line in lines[-20:]]

    def _read_rest(self) -> None:
        with suppress(OSError):  # nothing left to read
            for _ in range(100):
                self._tail = (self._tail + os.read(self._output, 1 << 16))[-TAIL:]

    def _write(self, request: bytes) -> bytes:
        """Write a part of a request; return the rest, nothing if the process reads no more."""
        try:
            return request[os.write(self._requests, request) :]
        except BrokenPipeError:
            return b""

    def _last_line(self) -> str:
        self._read_rest()
        text = next((line for line in reversed(self.last_lines) if line), "")
        return f" (it printed last: {text[:200]})" if text else ""

    def _why_no_answer(self) -> str:
        status = self._end(WHY)
        if status == STILL_RUNS:
            return f"its process closed the pipe of its answers{self._last_line()}"
        if status == NO_LAUNCHER:
            return "it takes too long or too much memory to compile"
        if status > namespaces.SIGNALLED:
            return f"its process was ended by {signal.Signals(status - namespaces.SIGNALLED).name}{self._last_line()}"
        return f"its process ended with status {status} before the run was done{self._last_line()}"


def environment(ours: Mapping[str, str]) -> dict[str, str]:
    """Return the environment of processes with user code: the places of libraries and of their caches."""
    kept = {name: value for name, value in ours.items() if name in KEPT or name.startswith(KEPT_BEGINNINGS)}
    folders = dict.fromkeys(("HOME", "TMPDIR", "PWD"), tempfile.gettempdir())  # each process sets its own
    return {
        **kept,
        **folders,
        "XDG_CACHE_HOME": str(caches()),
        "PYTHONUSERBASE": site.getuserbase(),
        "MPLBACKEND": "agg",
    }
