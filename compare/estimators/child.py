"""User code in a child process: started once, it answers one recording after the other, and is ended at any trouble.

What the code prints goes to a file; one line names it. Behind a wall (`sandbox`) the process sees a copy of its folder.
"""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import weakref
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from time import monotonic
from typing import IO, NamedTuple

from slamgauge.compare.estimators.addresses import Address, Noise
from slamgauge.compare.estimators.answers import Answer, message, printable, read_answer
from slamgauge.compare.estimators.forms.external_program import end_group, last_lines
from slamgauge.compare.estimators.forms.signatures import refusal
from slamgauge.compare.estimators.sandbox import CODE, environment, require_wall, walled
from slamgauge.compare.estimators.user_errors import FormError, OverdueError, UserCodeError
from slamgauge.compare.storage.safe_names import file_name
from slamgauge.estimate import Estimate
from slamgauge.notices import tell_first
from slamgauge.recording import Recording

WORKER = "slamgauge.compare.estimators.worker"
STARTING = 120.0  # s: largest time for the imports of Python, slamgauge and libraries
MOST_PRINTED = 10_000_000  # bytes of output in a run
POLL = 1.0  # s between looks at the size of the output
ENDING = 5.0  # s: time for a process that has closed its answers to end
FIRST, WIDEST = 3, 120  # lines of output in error messages, and characters of each


class Limits(NamedTuple):
    """Limits of user code.

    Attributes:
        seconds: largest time of a run, and of loading [s].
        is_walled: whether it runs behind the wall (`sandbox`).
    """

    seconds: float = 600.0
    is_walled: bool = False


class Run(NamedTuple):
    """A run of user code.

    Attributes:
        estimate: what it returned.
        seconds: computing time.
        remarks: sentences on settings of the file that are replaced or kept.
        replaces_noise: whether the noise of the recording replaced another one of the file.
    """

    estimate: Estimate
    seconds: float
    remarks: list[str]
    replaces_noise: bool


class Host:
    """Runs user code at an address in a process that is started when it is needed, and again after it has ended."""

    def __init__(self, where: Address, limits: Limits) -> None:
        self.where, self.limits = where, limits
        self._form = ""
        self._process: _Process | None = None
        self._turn = threading.Lock()  # one run at a time
        self.last_output = ""  # the last lines that it printed in the last run

    def begin(self) -> str:
        """Start the process and load the code; return the form of the code in words (see `adapters`).

        Raises:
            UserCodeError: the code cannot be loaded, or has none of the forms.
            UserError: this system has no wall.
        """
        if self._process is None:
            process = _Process(self.where, self.limits)
            try:
                self._form = self._loaded(process)
            except UserCodeError:
                process.end()
                raise
            self._process = process
        return self._form

    def _loaded(self, process: _Process) -> str:
        text = self.where.text
        try:
            process.exchange(b"", STARTING)
            answer = process.exchange(message(process.address), self.limits.seconds)
        except OverdueError as error:
            what = f"cannot be loaded, it was not done after {self.limits.seconds:g} s"
            remedy = 'put what plots or simulates under `if __name__ == "__main__":`, or give a longer --timeout'
            raise OverdueError(f"estimator {text}: {what}; {remedy}{process.printed}") from error
        except UserCodeError as error:
            raise type(error)(f"estimator {text}: cannot be loaded, {error}") from error
        if isinstance(answer.error, FormError):
            raise refusal(text, answer.error)
        if answer.error is not None:
            raise UserCodeError(f"estimator {text}: {answer.error}{process.printed}")
        self.where = self.where._replace(attribute=answer.text("attribute"))
        return answer.text("form")

    def run(self, recording: Recording, noise: Noise = "recording") -> Run:
        """Run the code on a recording.

        Raises:
            UserCodeError: it raised an error, exceeded its limits, or ended its process.
        """
        with self._turn:
            self.begin()
            process = self._process
            assert process is not None
            start = monotonic()
            try:
                answer = process.exchange(message({"noise": noise}, recording), self.limits.seconds)
                run = None if answer.error is not None else _run(answer, monotonic() - start)
            except BaseException:
                self.last_output = process.last_lines
                self.close()
                raise
            self.last_output = process.last_lines
            if run is None:
                assert answer.error is not None
                raise type(answer.error)(f"{answer.error}{process.printed}")
            if process.printed and not self.limits.is_walled:
                label = self.where.label
                tell_first(f"{label} prints", f"{label}: what it prints is kept in {process.output.name}")
            return run

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.end()
            self._process = None


def _run(answer: Answer, elapsed: float) -> Run:
    """Return the run of an answer that took at most some seconds."""
    return Run(answer.estimate(), answer.seconds(elapsed), answer.texts("remarks"), answer.flag("replaces_noise"))


@lru_cache(maxsize=16)
def shared_host(where: Address, limits: Limits) -> Host:
    """Return the host of an address in this process: all runs of a study use the same."""
    return Host(where, limits)


class _Process:
    """A process with user code, its pipes and the file of its output."""

    def __init__(self, where: Address, limits: Limits) -> None:
        command = [sys.executable, "-P", "-m", WORKER, *(["walled"] if limits.is_walled else [])]
        copied, folder = None, Path.cwd() if where.code is None else None
        if limits.is_walled:
            require_wall()
            copied = tempfile.TemporaryDirectory(prefix="slamgauge-own-", ignore_cleanup_errors=True)
            if where.code is not None:
                where.code.copy_to(Path(copied.name))
                folder = Path(CODE)
            command = walled(command, None if where.code is None else Path(copied.name))
        elif where.code is not None:
            folder = where.code.place()
        files = [] if where.code is None else [path for path, _ in where.code.files if path.endswith(".py")]
        module = where.place if where.code is None else where.code.module
        self.address: dict[str, object] = {
            "folder": str(folder),
            "module": module,
            "attribute": where.attribute,
            "files": files,
            "place": where.place,
        }
        name = f"slamgauge-printed-{file_name(where.label)[:40]}-"
        descriptor, path = tempfile.mkstemp(prefix=name, suffix=".txt")
        os.close(descriptor)
        self.output: IO[bytes] = Path(path).open("ab")  # noqa: SIM115 appends, for two processes
        self._is_walled = limits.is_walled
        self._process = subprocess.Popen(
            command,
            cwd=None if limits.is_walled else folder,
            env=environment(os.environ) if limits.is_walled else os.environ | {"MPLBACKEND": "agg"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.output,
            start_new_session=True,
        )
        self.end = weakref.finalize(self, _end, self._process, self.output, copied, keeps_output=not limits.is_walled)

    def exchange(self, request: bytes, seconds: float) -> Answer:
        """Write a request and read the answer; the file of output begins again.

        Raises:
            UserCodeError: it printed too much, has ended, or wrote a wrong answer.
            OverdueError: it did not answer in time.
        """
        self.output.truncate(0)
        found: queue.SimpleQueue[Answer | UserCodeError | None] = queue.SimpleQueue()
        threading.Thread(target=_exchanged, args=(self._process, request, found), daemon=True).start()
        deadline = monotonic() + seconds
        answer, is_there = None, False
        while not is_there:
            with suppress(queue.Empty):
                answer = found.get(timeout=max(0.0, min(POLL, deadline - monotonic())))
                is_there = True
            if os.fstat(self.output.fileno()).st_size > MOST_PRINTED:
                what = f"it printed more than {MOST_PRINTED / 1e6:g} MB in a run"
                raise UserCodeError(f"{what}; take the prints out{self.printed}")
            if not is_there and monotonic() >= deadline:
                remedy = "make it faster, or give a longer --timeout"
                raise OverdueError(f"it was not done after {seconds:g} s; {remedy}{self.printed}")
        if isinstance(answer, UserCodeError):
            raise answer
        if answer is None:
            raise UserCodeError(f"{self._why_no_answer()}{self.printed}")
        return answer

    @property
    def printed(self) -> str:
        """The end of an error message: the first lines of output, and where all are; empty if nothing was printed."""
        lines = (
            Path(self.output.name).read_bytes()[: 10 * FIRST * WIDEST].decode("utf-8", errors="replace").splitlines()
        )
        first = " / ".join([printable(line)[:WIDEST] for line in lines if line.strip()][:FIRST])
        place = "" if self._is_walled else f"; all in {self.output.name}"
        return f" (it printed first: {first}{place})" if first else ""

    @property
    def last_lines(self) -> str:
        """The last lines of its output, at most 20."""
        return "\n".join(last_lines(Path(self.output.name), 20))

    def _why_no_answer(self) -> str:
        try:
            status = self._process.wait(ENDING)
        except subprocess.TimeoutExpired:
            return "its process closed the pipe of its answers"
        number = -status if status < 0 else status - 128  # bwrap adds 128
        if number in {*signal.Signals}:
            return f"its process was ended by {signal.Signals(number).name}"
        return f"its process ended with status {status} before the run was done"


def _exchanged(
    process: subprocess.Popen[bytes], request: bytes, found: queue.SimpleQueue[Answer | UserCodeError | None]
) -> None:
    """Write a request and read the answer in a thread, because neither has a time limit."""
    assert process.stdin is not None and process.stdout is not None
    answer: Answer | UserCodeError | None = None
    try:
        with suppress(OSError):  # the answer, or that it is missing, tells more
            process.stdin.write(request)
            process.stdin.flush()
        answer = read_answer(process.stdout)
    except UserCodeError as error:
        answer = error
    except (OSError, ValueError):  # the pipes were closed meanwhile
        pass
    found.put(answer)


def _end(
    process: subprocess.Popen[bytes],
    output: IO[bytes],
    copied: tempfile.TemporaryDirectory[str] | None,
    *,
    keeps_output: bool,
) -> None:
    """End a process with all that it has started, and remove its files."""
    end_group(process)
    is_empty = os.fstat(output.fileno()).st_size == 0
    output.close()
    if is_empty or not keeps_output:
        Path(output.name).unlink(missing_ok=True)
    if copied is not None:
        copied.cleanup()
