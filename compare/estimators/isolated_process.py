"""People's code in a process of its own: recordings go there, estimates come back, the truth stays here.

A fresh interpreter (`isolated_program`), so that nothing of this process's memory is in it, in an empty temporary
folder that is its current one, its home and its temporary one. It is given npz files, and what it leaves is read by
the checked reader. What it prints is read as it comes and thrown away but for the last lines; too much of it, too
long a run, and the end of the process are errors of one line. `docs/your_filter.md` says what is not defended.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import site
import subprocess
import sys
import tempfile
import weakref
import zipfile
from base64 import b64encode
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from selectors import EVENT_READ, DefaultSelector
from time import monotonic
from types import TracebackType
from typing import Any, NamedTuple

from slamgauge.compare.estimators.user_code import Address, OwnCodeError
from slamgauge.compare.storage.files import load_estimate, save
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

PROGRAM = "slamgauge.compare.estimators.isolated_worker"
FOLDERS = "slamgauge-own-"  # how names of the temporary folders begin, which are removed in the end
HERE, GIVEN, MADE = "here", "given.npz", "made.npz"  # in the temporary folder: where it runs, and beside it what flows
STARTING = 120.0  # s: for Python and our own modules
LEAVING = 1.0  # s: what it has to end what it has started
MOST_PRINTED = 10_000_000  # bytes of a run
MOST_MADE = 500_000_000  # bytes of an estimate, uncompressed
LONGEST_ANSWER = 100_000  # bytes
TAIL = 4000  # bytes of what it printed last that are kept
LONGEST_REASON = 1000  # characters

KEPT = ("PATH", "PYTHONPATH", "VIRTUAL_ENV", "CONDA_PREFIX", "LANG", "LANGUAGE", "TZ", "SSL_CERT_FILE")
KEPT_BEGINNINGS = ("LC_", "LD_", "DYLD_", "NUMBA_", "OPENBLAS_", "MKL_", "OMP_", "KMP_", "VECLIB_")


def require_isolation(remedy: str) -> None:
    """Refuse where this system cannot isolate user code.

    Raises:
        UserError: with the remedy.
    """
    if not can_isolate():
        raise UserError(f"Windows cannot run user code in isolation; {remedy}")


def can_isolate() -> bool:
    """Return whether this system can isolate user code: it needs process groups, which Windows lacks."""
    return hasattr(os, "killpg")


class OverdueError(OwnCodeError):
    """People's code was not done in time."""


class Spent(NamedTuple):
    """What a run has cost in its process [s]: by the clock, and of processors."""

    seconds: float
    cpu_seconds: float


class Isolated:
    """An estimator in a process of its own, which serves one run after the other and ends with this object.

    Args:
        where: its address; without an attribute the callable is found by itself.
        timeout: of a run, and of loading [s].
    """

    def __init__(self, where: Address, timeout: float) -> None:
        self.where, self.timeout = where, timeout
        self.spent = Spent(0.0, 0.0)
        self._child: _Child | None = None

    def begin(self) -> str:
        """Start the process and load the code; its form in words, empty for a callable that takes a recording.

        Raises:
            UserError: it cannot be loaded.
        """
        if self._child is not None:
            return ""
        self._child = _Child()
        try:
            self._child.answer(STARTING)
            self._child.send(_as_json(self.where))
            told = self._child.answer(self.timeout)
        except OwnCodeError as error:
            self.close()
            raise UserError(f"estimator {self.where.text}: cannot be loaded, {error}") from error
        if "reason" in told:
            self.close()
            raise UserError(printable(told["reason"]))
        self.where = self.where._replace(attribute=printable(told.get("attribute")))
        return printable(told.get("form"))

    def __call__(self, recording: Recording) -> Estimate:
        """Run it.

        Raises:
            OwnCodeError: what it raised, or what has become of its process.
        """
        self.begin()
        child = self._child
        assert child is not None
        (child.folder / MADE).unlink(missing_ok=True)
        save(child.folder / GIVEN, recording)
        try:
            child.send({"run": True})
            told = child.answer(self.timeout)
        except OwnCodeError:
            self.close()
            raise
        if "reason" in told:
            raise OwnCodeError(printable(told["reason"]))
        self.spent = Spent(*(_number(told.get(key)) for key in Spent._fields))
        return _estimate(child.folder / MADE)

    def fresh(self) -> Isolated:
        """The same code in another process, which knows nothing of this one."""
        return Isolated(self.where, self.timeout)

    @property
    def last_words(self) -> str:
        """What it has printed last."""
        return "" if self._child is None else self._child.last_words()

    def close(self) -> None:
        """End its process, if there is one."""
        if self._child is not None:
            self._child.end()
            self._child = None

    def __enter__(self) -> Isolated:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


class _Child:
    """A process that runs `isolated_program`, and the pipes to it."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix=FOLDERS))
        here = self.folder / HERE
        here.mkdir()
        requests, self._requests = os.pipe()
        self._answers, answers = os.pipe()
        command = [sys.executable, "-P", "-m", PROGRAM, str(requests), str(answers)]
        self._process = subprocess.Popen(
            command,
            cwd=here,
            env=environment(os.environ, here),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            pass_fds=(requests, answers),
            start_new_session=True,
        )
        os.close(requests)
        os.close(answers)
        assert self._process.stdout is not None
        self._printed = self._process.stdout.fileno()
        os.set_blocking(self._printed, False)
        self._tail = b""
        self.end = weakref.finalize(self, _end, self._process, self.folder, (self._requests, self._answers))

    def send(self, message: Mapping[str, object]) -> None:
        """Write a line to the process; if it is gone, the answer will say so."""
        content = json.dumps(message).encode() + b"\n"
        try:
            while content:
                content = content[os.write(self._requests, content) :]
        except BrokenPipeError:
            return

    def answer(self, seconds: float) -> dict[str, Any]:
        """The line that it writes next; what it prints meanwhile is read, too.

        Raises:
            OwnCodeError: it has printed too much, is gone, or answers nonsense.
            OverdueError: nothing came in time.
        """
        deadline, printed, told = monotonic() + seconds, 0, b""
        with DefaultSelector() as selector:
            selector.register(self._answers, EVENT_READ)
            selector.register(self._printed, EVENT_READ)
            while not told.endswith(b"\n"):
                left = deadline - monotonic()
                if left <= 0:
                    remedy = "make it faster, or give a longer --timeout"
                    raise OverdueError(f"it was not done after {seconds:g} s; {remedy}{self._last_line()}")
                for key, _ in selector.select(left):
                    data = os.read(key.fd, 65536)
                    if key.fd == self._answers:
                        told += data
                        if not data or len(told) > LONGEST_ANSWER:
                            raise OwnCodeError(self._what_became())
                    elif data:
                        printed += len(data)
                        self._tail = (self._tail + data)[-TAIL:]
                        if printed > MOST_PRINTED:
                            what = f"it printed more than {MOST_PRINTED / 1e6:g} MB in a run"
                            raise OwnCodeError(f"{what}; take the prints out{self._last_line()}")
                    else:
                        selector.unregister(key.fd)
        try:
            content = json.loads(told)
        except ValueError:
            content = None
        if not isinstance(content, dict):
            raise OwnCodeError("its process answered what is no answer; leave the pipes that it is given alone")
        return content

    def last_words(self) -> str:
        """The lines that it printed last."""
        self._hear_out()
        lines = self._tail.decode("utf-8", errors="replace").splitlines()
        return "\n".join(printable(line) for line in lines[-20:])

    def _what_became(self) -> str:
        """Why there is no answer."""
        try:
            status = self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            return f"its process closed the pipe that it answers by{self._last_line()}"
        self._hear_out()
        if status < 0:
            return f"its process was ended by {signal.Signals(-status).name}{self._last_line()}"
        return f"its process ended with status {status} before the run was done{self._last_line()}"

    def _last_line(self) -> str:
        lines = [printable(line) for line in self._tail.decode("utf-8", errors="replace").splitlines()]
        said = next((line for line in reversed(lines) if line.strip()), "")
        return f" (it printed last: {said[:200]})" if said else ""

    def _hear_out(self) -> None:
        """Read what is left of its prints."""
        for _ in range(100):
            try:
                data = os.read(self._printed, 65536)
            except OSError:  # nothing there, or closed
                return
            self._tail = (self._tail + data)[-TAIL:]
            if not data:
                return


def environment(ours: Mapping[str, str], here: Path) -> dict[str, str]:
    """What the process is told of its surroundings: where libraries are, and nothing of our folders."""
    kept = {name: value for name, value in ours.items() if name in KEPT or name.startswith(KEPT_BEGINNINGS)}
    caches = ours.get("XDG_CACHE_HOME") or str(Path("~/.cache").expanduser())  # font lists, compiled kernels
    homes = {"HOME": str(here), "TMPDIR": str(here), "PWD": str(here), "XDG_CACHE_HOME": caches}
    return {**kept, **homes, "PYTHONUSERBASE": site.getuserbase(), "MPLBACKEND": "agg"}


def _end(process: subprocess.Popen[bytes], folder: Path, pipes: tuple[int, ...]) -> None:
    """End the process with all that it has started, and remove its folder.

    Asked to, it ends programs that lead groups of their own (`external_program`); then all of its own group is ended.
    """
    if process.poll() is None:
        process.terminate()
        with suppress(subprocess.TimeoutExpired):
            process.wait(LEAVING)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    if process.stdout is not None:
        process.stdout.close()
    for pipe in pipes:
        os.close(pipe)
    shutil.rmtree(folder, ignore_errors=True)


def _as_json(where: Address) -> dict[str, object]:
    sources = where.sources
    if sources is None:
        return where._asdict()
    files = [[path, b64encode(content).decode()] for path, content in sources.files]
    return {**where._asdict(), "sources": {"folder": sources.folder, "module": sources.module, "files": files}}


def _estimate(path: Path) -> Estimate:
    """What it has left, which anybody may have written.

    Raises:
        OwnCodeError: nothing, or no estimate.
    """
    if path.is_symlink() or not path.is_file():
        raise OwnCodeError("its process has left no estimate; leave the folder above its own alone")
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(each.file_size for each in archive.infolist())
    except (zipfile.BadZipFile, OSError):
        raise OwnCodeError("its process has left what is no estimate; leave the folder above its own alone") from None
    if size > MOST_MADE:
        raise OwnCodeError(f"its estimate has {size / 1e6:.0f} MB; keep it below {MOST_MADE / 1e6:.0f} MB")
    try:
        return load_estimate(path)
    except UserError as error:
        raise OwnCodeError(str(error).removeprefix(f"{path}: ")) from None


def printable(text: object) -> str:
    """A text of theirs without control characters, which terminals obey and XML cannot hold, and not too long."""
    shown = "".join(each if each.isprintable() else " " for each in str(text or "")[:LONGEST_REASON])
    return " ".join(shown.split())


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else 0.0
