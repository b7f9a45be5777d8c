"""Processes for user code: each receives one recording and returns one estimate, behind a wall and without the truth.

`launcher` forks them, so that every run is the first one. Recordings and estimates go through pipes (`answers`). Output
is read as it comes, and only the end is kept. Too much output, too long a run and the end of the process are errors of
one line. `docs/your_filter.md` describes the wall.
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
from typing import NamedTuple

from slamgauge.compare.estimators.answers import Answer, Incoming, Spent, address_fields, message, printable
from slamgauge.compare.estimators.sources import Sources, added_folders, imported_names
from slamgauge.compare.estimators.user_code import Address, UserCodeError
from slamgauge.compare.estimators.wall import caches, kind_of_wall, require_wall
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

PROGRAM = "slamgauge.compare.estimators.launcher"
START, END, WHY = b"+", b"-", b"?"  # requests to the launcher
STILL_RUNS, SIGNALLED = 255, 128  # status of a process that has not ended; added to the number of a signal
STARTING = 120.0  # s: largest time for the imports of Python, slamgauge and libraries
MOST_PRINTED = 10_000_000  # bytes of output in a run
TAIL = 4000  # bytes of output that are kept

KEPT = ("PATH", "PYTHONPATH", "VIRTUAL_ENV", "CONDA_PREFIX", "LANG", "LANGUAGE", "TZ", "SSL_CERT_FILE")
KEPT_BEGINNINGS = ("LC_", "LD_", "DYLD_", "NUMBA_", "OPENBLAS_", "MKL_", "OMP_", "KMP_", "VECLIB_")


def require_isolation(remedy: str, *, unconfined: bool) -> None:
    """Refuse where this system cannot isolate user code.

    Raises:
        UserError: with the remedy.
    """
    if not can_isolate():
        raise UserError(f"Windows cannot run user code in isolation; {remedy}")
    require_wall(unconfined=unconfined)


def can_isolate() -> bool:
    """Return whether this system can isolate user code: it needs process groups, which Windows lacks."""
    return hasattr(os, "killpg")


class OverdueError(UserCodeError):
    """User code exceeded its timeout."""


class IsolatedRun(NamedTuple):
    """A run of user code.

    Attributes:
        estimate: what it returned.
        spent: its times.
        remarks: see `forms.form.remarks_of`.
        replaces_noise: see `forms.form.replaces_noise`.
    """

    estimate: Estimate
    spent: Spent
    remarks: list[str]
    replaces_noise: bool


class Isolated:
    """An estimator that runs in a new process each time.

    Args:
        where: address of the user code; without an attribute the child finds the callable.
        timeout: largest time of a run, and of loading [s].
        unconfined: whether the processes run without a wall.
    """

    def __init__(self, where: Address, timeout: float, *, unconfined: bool = False) -> None:
        self.where, self.timeout, self.unconfined = where, timeout, unconfined
        self.spent = Spent(0.0, 0.0)
        self.replaces_noise = False  # in the last run (see `forms.form.replaces_noise`)
        self._remarks: list[str] = []
        self._launcher: _Launcher | None = None
        self._form = ""
        self._loaded: _Process | None = None  # it waits for a recording
        self._last_lines: list[str] = []

    def begin(self) -> str:
        """Load the code in a process that waits for a recording; return the description of its form (see `adapters`).

        Raises:
            UserError: the code cannot be loaded, or this system has no wall.
        """
        if self._loaded is not None:
            return self._form
        if self._launcher is None:
            self._launcher = _Launcher(self.where, unconfined=self.unconfined)
        process = _Process(self._launcher)
        try:
            process.exchange(message(address_fields(self.where)), STARTING)
            answer = process.exchange(b"", self.timeout)
        except UserCodeError as error:
            process.end()
            raise UserError(f"estimator {self.where.text}: cannot be loaded, {error}") from error
        self._loaded = process
        if answer.reason:
            self.close()
            raise UserError(answer.reason)
        self.where = self.where._replace(attribute=answer.text("attribute"))
        self._form = answer.text("form")
        return self._form

    def __call__(self, recording: Recording) -> Estimate:
        """Run the estimator, and keep times and remarks of the run.

        Raises:
            UserCodeError: the code raised an error, exceeded the timeout, or ended its process.
        """
        run = self.run(recording)
        self.spent, self._remarks, self.replaces_noise = run.spent, run.remarks, run.replaces_noise
        return run.estimate

    def run(self, recording: Recording) -> IsolatedRun:
        """Run the estimator.

        Raises:
            UserCodeError: as `__call__`.
        """
        self.begin()
        process, self._loaded = self._loaded, None
        assert process is not None
        start = monotonic()
        try:
            answer = process.exchange(message({}, recording), self.timeout)
        finally:
            process.end()
            self._last_lines = process.last_lines
        if answer.reason:
            raise UserCodeError(answer.reason)
        spent = answer.spent(monotonic() - start)
        return IsolatedRun(answer.estimate(), spent, answer.texts("remarks"), answer.flag("replaces_noise"))

    def remarks(self, _recording: Recording) -> list[str]:
        """Return the remarks on the last run (see `forms.form.remarks_of`)."""
        return self._remarks

    @property
    def last_output(self) -> str:
        """The last lines that it printed in the last run."""
        return "\n".join(self._last_lines)

    def close(self) -> None:
        """End all processes."""
        if self._loaded is not None:
            self._loaded.end()
            self._loaded = None
        if self._launcher is not None:
            self._launcher.end()
            self._launcher = None


class _Launcher:
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
        with suppress(BrokenPipeError), self._process.stdin as settings:  # `_Process` tells that it has ended
            settings.write(json.dumps(_settings(where)).encode() + b"\n")


def _settings(where: Address) -> dict[str, object]:
    """Return what the launcher imports and shows."""
    sources = where.sources or Sources("", "", ())
    folder = Path(sources.folder)
    added = {each for _, content in sources.files for each in added_folders(folder, content)}
    names = sorted({name for _, content in sources.files for name in imported_names(content)})
    neighbours = [path for path, _ in sources.files]
    shown = {"folder": sources.folder, "neighbours": neighbours, "added": sorted(added), "strangers": where.strangers}
    return {"view": shown, "imports": names}


def _end(process: subprocess.Popen[bytes], requests: socket.socket) -> None:
    """End the launcher, which ends the processes that it has forked."""
    requests.close()
    process.wait()


class _Process:
    """A process with user code, and the pipes to it. A launcher has one at a time."""

    def __init__(self, launcher: _Launcher) -> None:
        self._launcher = launcher
        (theirs, self._requests), (self._answers, answers), (self._output, output) = os.pipe(), os.pipe(), os.pipe()
        for each in (self._requests, self._output):
            os.set_blocking(each, False)
        with suppress(BrokenPipeError):  # `exchange` tells that the launcher has ended
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
            while answer is None:
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
            self._status = 0
            with suppress(OSError):  # the launcher has ended
                self._launcher.requests.sendall(request)
                self._status = ord(self._launcher.requests.recv(1) or b"\0")
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
        if status > SIGNALLED:
            return f"its process was ended by {signal.Signals(status - SIGNALLED).name}{self._last_line()}"
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
