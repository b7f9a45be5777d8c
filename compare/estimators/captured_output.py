"""What user code prints is kept in a file, so that it hides no results and no messages.

A command with its worker processes has one file for each estimator that prints, in the system's temporary folder, of at
most `LARGEST` bytes.
Only the output of the current thread is redirected: other threads of a study print as before.
"""

from __future__ import annotations

import io
import os
import secrets
import sys
import tempfile
import threading
import warnings
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import numpy as np

from slamgauge.compare.storage.safe_names import file_name, shown
from slamgauge.notices import tell_once

LARGEST = 10_000_000  # bytes
FIRST = 3  # lines that error messages contain
WIDEST = 120  # characters of such a line

_lock = threading.RLock()
_thread = threading.local()  # .target: where the current thread prints
_streams: list[_Stream] = []  # all that were made
_users = 0  # threads and contexts whose output is redirected
_files: dict[str, IO[str]] = {}  # estimator -> its open file
_made: set[str] = set()  # estimators whose file this process has made
_command = [secrets.token_hex(8)]  # part of the names of files; workers have that of their command


def command() -> str:
    """Return the part of the names of files that this process shares with its workers."""
    return _command[0]


def belong_to(command: str) -> None:
    """Write to the files of the process whose `command()` this is."""
    _command[:] = [command]


class Captured(io.TextIOBase):
    """A text stream that writes to the file of an estimator."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._beginning = ""

    def write(self, text: str, /) -> int:
        """Append a text to the file, as far as this may grow."""
        if len(self._beginning) < FIRST * WIDEST:
            self._beginning += text[: FIRST * WIDEST]
        file = _file_of(self._name)
        if file is not None and os.fstat(file.fileno()).st_size < LARGEST:
            file.write(text)
            file.flush()
        return len(text)

    @property
    def first_lines(self) -> str:
        """The first lines, in one line; empty if nothing was printed."""
        lines = [shown(line.strip()[:WIDEST]) for line in self._beginning.splitlines() if line.strip()]
        return " / ".join(lines[:FIRST])

    @property
    def place(self) -> Path | None:
        """The file; None if nothing was printed, or no file could be made."""
        file = _files.get(self._name)
        return None if file is None else Path(file.name)

    @property
    def as_reason(self) -> str:
        """The end of an error message: the first lines and the file; empty if nothing was printed."""
        return f" (it printed first: {self.first_lines}; all in {self.place})" if self.first_lines else ""


class _Stream:
    """A stream that replaces `sys.stdout` or `sys.stderr` and writes to the target of the current thread."""

    def __init__(self, original: Any) -> None:
        self.original = original

    def write(self, text: str, /) -> int:
        target = getattr(_thread, "target", None)
        return (self.original if target is None else target).write(text)

    def writelines(self, lines: Any, /) -> None:
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.original, name)


@contextmanager
def captured(name: str) -> Generator[Captured]:
    """Keep away what this thread prints inside, and tell once in which file it is.

    Inside another `captured` of the thread, that one gets the output.
    """
    outer = getattr(_thread, "target", None)
    output = outer if isinstance(outer, Captured) else Captured(name)
    try:
        with _redirected(output):
            yield output
    finally:
        if output is not outer and output.first_lines and name in _made:
            tell_once(f"{name}: what it prints is kept in {output.place}")


@contextmanager
def discarded() -> Generator[None]:
    """Discard what this thread prints inside, warnings, and numpy's messages on overflow and division by zero."""
    with _redirected(io.StringIO()), warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


@contextmanager
def stdout_to_stderr() -> Generator[None]:
    """Redirect what this thread prints to standard error, or to the file of `captured` around it."""
    outer = getattr(_thread, "target", None)
    with _redirected(_unwrapped(sys.stderr) if outer is None else outer):
        yield


@contextmanager
def _redirected(target: Any) -> Generator[None]:
    """Send output of this thread to a target; the last thread that leaves restores the streams of the process."""
    global _users
    outer = getattr(_thread, "target", None)
    with _lock:
        _users += 1
        if _users == 1:
            sys.stdout, sys.stderr = _wrapped(sys.stdout), _wrapped(sys.stderr)
    _thread.target = target
    try:
        yield
    finally:
        _thread.target = outer
        with _lock:
            _users -= 1
            if not _users:
                sys.stdout, sys.stderr = _unwrapped(sys.stdout), _unwrapped(sys.stderr)


def _wrapped(stream: Any) -> _Stream:
    """Return the stream around an original, always the same: `print` of another thread may still use it after its end.

    Python before 3.14 crashes if `sys.stdout` is freed during a `print`.
    """
    for each in _streams:
        if each.original is stream:
            return each
    _streams.append(_Stream(stream))
    return _streams[-1]


def _unwrapped(stream: Any) -> Any:
    return stream.original if isinstance(stream, _Stream) else stream


def _file_of(name: str) -> IO[str] | None:
    """Return the open file of an estimator, which the first process of a command that prints makes."""
    if name not in _files:
        path = Path(tempfile.gettempdir(), f"slamgauge-printed-{file_name(name)[:40]}-{command()}.txt")
        try:
            with suppress(FileExistsError):
                path.touch(mode=0o600, exist_ok=False)
                _made.add(name)
            _files[name] = path.open("a", encoding="utf-8", errors="replace")
        except OSError:  # no room: it is dropped
            return None
    return _files[name]
