"""A child process for user code: it receives recordings and returns estimates, and never has the truth.

`isolated_worker` runs in it, in a fresh interpreter whose memory contains nothing of this process. An empty temporary
folder is its current, home and temporary folder. Recordings and estimates are npz files beside that folder. Its output
is read as it comes, and only the end is kept. Too much output, too long a run and the end of the process are errors of
one line. `docs/your_filter.md` describes what this does not protect against.
"""

from __future__ import annotations

import json
import os
import pickle
import shutil
import signal
import site
import subprocess
import sys
import tempfile
import weakref
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from selectors import EVENT_READ, DefaultSelector
from time import monotonic
from typing import Any, NamedTuple

from slamgauge.compare.estimators.user_code import Address, UserCodeError
from slamgauge.compare.storage.files import load_estimate, save
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

PROGRAM = "slamgauge.compare.estimators.isolated_worker"
FOLDERS = "slamgauge-own-"  # prefix of the temporary folders
HERE, GIVEN, MADE = "here", "given.npz", "made.npz"  # in the temporary folder: current folder, recording, estimate
STARTING = 120.0  # s: largest time for the imports of Python and slamgauge
LEAVING = 1.0  # s: time for the child to end the programs that it has started
MOST_PRINTED = 10_000_000  # bytes of output in a run
MOST_MADE = 500_000_000  # bytes of an estimate, uncompressed
LONGEST_ANSWER = 100_000  # bytes
TAIL = 4000  # bytes of output that are kept
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


class OverdueError(UserCodeError):
    """User code exceeded its timeout."""


class Spent(NamedTuple):
    """Elapsed time and processor time of a run in the child process [s]."""

    seconds: float
    cpu_seconds: float


class Isolated:
    """An estimator in a child process, which starts with the first run and serves all runs until `close`.

    Args:
        where: address of the user code; without an attribute the child finds the callable.
        timeout: largest time of a run, and of loading [s].
    """

    def __init__(self, where: Address, timeout: float) -> None:
        self.where, self.timeout = where, timeout
        self.spent = Spent(0.0, 0.0)
        self.replaces_noise = False  # in the last run (see `forms.form.replaces_noise`)
        self._remarks: list[str] = []
        self._child: _Child | None = None

    def begin(self) -> str:
        """Start the process and load the code; return the description of its form (see `adapters.adapted_callable`).

        Raises:
            UserError: the code cannot be loaded.
        """
        if self._child is not None:
            return ""
        self._child = _Child()
        try:
            self._child.answer(STARTING)
            self._child.send(pickle.dumps(self.where))
            answer = self._child.answer(self.timeout)
        except UserCodeError as error:
            self.close()
            raise UserError(f"estimator {self.where.text}: cannot be loaded, {error}") from error
        if "reason" in answer:
            self.close()
            raise UserError(printable(answer["reason"]))
        self.where = self.where._replace(attribute=printable(answer.get("attribute")))
        return printable(answer.get("form"))

    def __call__(self, recording: Recording) -> Estimate:
        """Run the estimator.

        Raises:
            UserCodeError: the code raised an error, exceeded the timeout, or ended its process.
        """
        self.begin()
        child = self._child
        assert child is not None
        (child.folder / MADE).unlink(missing_ok=True)
        save(child.folder / GIVEN, recording)
        try:
            child.send(b"run\n")
            answer = child.answer(self.timeout)
        except UserCodeError:
            self.close()
            raise
        if "reason" in answer:
            raise UserCodeError(printable(answer["reason"]))
        self.spent = Spent(*(_number(answer.get(key)) for key in Spent._fields))
        self._remarks = [printable(each) for each in _list(answer.get("remarks"))]
        self.replaces_noise = answer.get("replaces_noise") is True
        return _load_estimate(child.folder / MADE)

    def remarks(self, _recording: Recording) -> list[str]:
        """Return the remarks on the last run (see `forms.form.remarks_of`)."""
        return self._remarks

    def fresh(self) -> Isolated:
        """Return the same estimator in another process, which shares no state with this one."""
        return Isolated(self.where, self.timeout)

    @property
    def last_output(self) -> str:
        """The last lines that it printed."""
        return "" if self._child is None else "\n".join(self._child.last_lines())

    def close(self) -> None:
        """End the process, if it runs."""
        if self._child is not None:
            self._child.end()
            self._child = None


class _Child:
    """A process that runs `isolated_worker`, and the pipes to it."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix=FOLDERS))
        here = self.folder / HERE
        here.mkdir()
        requests, self._requests = os.pipe()
        self._answers, answers = os.pipe()
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", PROGRAM, str(requests), str(answers)],
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
        self._output = self._process.stdout.fileno()
        os.set_blocking(self._output, False)
        self._tail = b""
        self.end = weakref.finalize(self, _end, self._process, self.folder, (self._requests, self._answers))

    def send(self, content: bytes) -> None:
        """Write a request to the process; if it has ended, `answer` raises the error."""
        with suppress(BrokenPipeError):
            while content:
                content = content[os.write(self._requests, content) :]

    def answer(self, seconds: float) -> dict[str, Any]:
        """Read the next answer of the process, a line of JSON, and meanwhile its output.

        Raises:
            UserCodeError: it printed too much, has ended, or wrote a wrong answer.
            OverdueError: it did not answer in time.
        """
        deadline, printed, line = monotonic() + seconds, 0, b""
        with DefaultSelector() as selector:
            selector.register(self._answers, EVENT_READ)
            selector.register(self._output, EVENT_READ)
            while not line.endswith(b"\n"):
                left = deadline - monotonic()
                if left <= 0:
                    remedy = "make it faster, or give a longer --timeout"
                    raise OverdueError(f"it was not done after {seconds:g} s; {remedy}{self._last_line()}")
                for key, _ in selector.select(left):
                    data = os.read(key.fd, 65536)
                    if key.fd == self._answers:
                        line += data
                        if not data or len(line) > LONGEST_ANSWER:
                            raise UserCodeError(self._why_no_answer())
                    elif data:
                        printed += len(data)
                        self._tail = (self._tail + data)[-TAIL:]
                        if printed > MOST_PRINTED:
                            what = f"it printed more than {MOST_PRINTED / 1e6:g} MB in a run"
                            raise UserCodeError(f"{what}; take the prints out{self._last_line()}")
                    else:
                        selector.unregister(key.fd)
        with suppress(ValueError):
            if isinstance(content := json.loads(line), dict):
                return content
        raise UserCodeError("its process wrote a wrong answer; leave the pipes that it is given alone")

    def last_lines(self) -> list[str]:
        """Return the last lines of its output, at most 20."""
        with suppress(OSError):  # nothing left to read
            for _ in range(100):
                self._tail = (self._tail + os.read(self._output, 65536))[-TAIL:]
        lines = self._tail.decode("utf-8", errors="replace").splitlines()
        return [printable(line) for line in lines[-20:]]

    def _last_line(self) -> str:
        text = next((line for line in reversed(self.last_lines()) if line), "")
        return f" (it printed last: {text[:200]})" if text else ""

    def _why_no_answer(self) -> str:
        try:
            status = self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            return f"its process closed the pipe of its answers{self._last_line()}"
        if status < 0:
            return f"its process was ended by {signal.Signals(-status).name}{self._last_line()}"
        return f"its process ended with status {status} before the run was done{self._last_line()}"


def environment(ours: Mapping[str, str], here: Path) -> dict[str, str]:
    """Return the environment of the child: the places of libraries, and `here` as home folder."""
    kept = {name: value for name, value in ours.items() if name in KEPT or name.startswith(KEPT_BEGINNINGS)}
    caches = ours.get("XDG_CACHE_HOME") or str(Path("~/.cache").expanduser())  # font lists, compiled kernels
    homes = {"HOME": str(here), "TMPDIR": str(here), "PWD": str(here), "XDG_CACHE_HOME": caches}
    return {**kept, **homes, "PYTHONUSERBASE": site.getuserbase(), "MPLBACKEND": "agg"}


def _end(process: subprocess.Popen[bytes], folder: Path, pipes: tuple[int, ...]) -> None:
    """End the process with all that it has started, and remove its folder.

    SIGTERM lets it end programs with their own process groups (`external_program`); SIGKILL ends its own group.
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


def _load_estimate(path: Path) -> Estimate:
    """Load a file that user code may have replaced.

    Raises:
        UserCodeError: the file does not exist, is too large, or is not an estimate.
    """
    if path.is_symlink() or not path.is_file():
        raise UserCodeError("its process has left no estimate; leave the folder above its own alone")
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(each.file_size for each in archive.infolist())
    except (zipfile.BadZipFile, OSError):  # numpy would read an npy file, of whatever size its header states
        raise UserCodeError(
            "its process has left a file that is no estimate; leave the folder above its own alone"
        ) from None
    if size > MOST_MADE:
        raise UserCodeError(f"its estimate has {size / 1e6:.0f} MB; keep it below {MOST_MADE / 1e6:.0f} MB")
    try:
        return load_estimate(path)
    except UserError as error:
        raise UserCodeError(str(error).removeprefix(f"{path}: ")) from None


def printable(text: object) -> str:
    """Return a text of user code without control characters, which terminals obey and XML excludes, and shortened."""
    shown = "".join(each if each.isprintable() else " " for each in str(text or "")[:LONGEST_REASON])
    return " ".join(shown.split())


def _list(value: object) -> list[object]:
    return [*value] if isinstance(value, list) else []


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else 0.0
