"""User code in a child process: started once, it answers one recording after the other, and is ended at any trouble.

What the code prints goes to a file; one line names it. Behind a wall (`sandbox`) the process sees a copy of its folder.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
import weakref
from concurrent.futures import Future, wait
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from time import monotonic
from typing import IO, NamedTuple

from slamgauge.compare.estimators.answers import Answer, message, printable, read_answer
from slamgauge.compare.estimators.forms.external_program import end_group, last_lines
from slamgauge.compare.estimators.forms.signatures import Noise
from slamgauge.compare.estimators.requests import Address, Limits
from slamgauge.compare.estimators.sandbox import CODE, environment, require_wall, walled
from slamgauge.compare.estimators.user_errors import FormError, OverdueError, UserCodeError
from slamgauge.compare.storage.result_files import file_name
from slamgauge.estimate import Estimate
from slamgauge.notices import tell_once
from slamgauge.recording import Recording

WORKER = "slamgauge.compare.estimators.worker"
STARTING = 120.0  # s: largest time for the imports of Python, slamgauge and libraries
MOST_PRINTED = 10_000_000  # bytes of output in a run
POLL = 1.0  # s between looks at the size of the output
ENDING = 5.0  # s: time for a process that has closed its answers to end
FIRST, LAST, WIDEST = 3, 20, 120  # lines of output in error messages and reports, and characters of each


class Run(NamedTuple):
    """A run of user code: what it returned, its computing time, and remarks on its form (`forms.signatures.Form`)."""

    estimate: Estimate
    seconds: float
    remarks: list[str]
    replaces_noise: bool


class Host:
    """Runs user code at an address in a process that is started when it is needed, and again after it has ended.

    `where` has the name of the callable once the code is loaded, and `last_output` the last lines of the last run.
    """

    def __init__(self, where: Address, limits: Limits) -> None:
        self.where, self.limits, self.last_output = where, limits, ""
        self._form = ""
        self._process: subprocess.Popen[bytes] | None = None
        self._turn = threading.Lock()  # one run at a time

    def begin(self) -> str:
        """Start the process and load the code; return its form in words. `UserError`: this system has no wall.

        `UserCodeError`: the code cannot be loaded, or has none of the forms.
        """
        if self._process is None:
            try:
                self._form = self._loaded(*self._started())
            except UserCodeError:
                self.close()
                raise
        return self._form

    def _started(self) -> tuple[subprocess.Popen[bytes], bytes]:
        """Start the process; return it with the first request, the address of the code."""
        where, is_walled = self.where, self.limits.is_walled
        command = [sys.executable, "-P", "-m", WORKER, *(["walled"] if is_walled else [])]
        folder = where.code.place(as_copy=is_walled) if where.code is not None else None
        if is_walled:
            require_wall()
            command = walled(command, folder)
            folder = folder and Path(CODE)
        descriptor, path = tempfile.mkstemp(prefix=f"slamgauge-printed-{file_name(where.label)[:40]}-", suffix=".txt")
        os.close(descriptor)
        self._output: IO[bytes] = Path(path).open("ab")  # noqa: SIM115 appends, for two processes
        process = subprocess.Popen(
            command,
            cwd=None if is_walled else folder,
            env=environment(os.environ) if is_walled else os.environ | {"MPLBACKEND": "agg"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._output,
            start_new_session=True,
        )
        self._process, self._end = process, weakref.finalize(self, _end, process, self._output, is_kept=not is_walled)
        files = [] if where.code is None else [path for path, _ in where.code.files if path.endswith(".py")]
        module = where.place if where.code is None else where.code.module
        address = {"folder": str(folder or Path.cwd()), "module": module, "attribute": where.attribute}
        return process, message(address | {"files": files, "place": where.place})

    def _loaded(self, process: subprocess.Popen[bytes], address: bytes) -> str:
        text = self.where.text
        try:
            self._exchange(process, b"", STARTING)
            answer = self._exchange(process, address, self.limits.seconds)
        except OverdueError as error:
            what = f"cannot be loaded, it was not done after {self.limits.seconds:g} s"
            remedy = 'put what plots or simulates under `if __name__ == "__main__":`, or give a longer --timeout'
            raise OverdueError(f"estimator {text}: {what}; {remedy}{self._printed}") from error
        except UserCodeError as error:
            raise type(error)(f"estimator {text}: cannot be loaded, {error}") from error
        if answer.error is not None:
            raise self._reported(answer.error, f"estimator {text}: ")
        self.where = self.where._replace(attribute=answer.text("attribute"))
        return answer.text("form")

    def run(self, recording: Recording, noise: Noise = "recording") -> Run:
        """Run the code on a recording; `UserCodeError`: it raised an error, exceeded its limits, or ended."""
        with self._turn:
            self.begin()
            assert self._process is not None
            start, run = monotonic(), None
            try:
                answer = self._exchange(self._process, message({"noise": noise}, recording), self.limits.seconds)
                if (error := answer.error) is None:
                    seconds = answer.seconds(monotonic() - start)
                    run = Run(answer.estimate(), seconds, answer.texts("remarks"), answer.flag("replaces_noise"))
            except BaseException:
                self.close()
                raise
            self.last_output = "\n".join(last_lines(Path(self._output.name), LAST))
            if run is None:
                assert error is not None
                raise self._reported(error)
            if self._printed and not self.limits.is_walled:
                label = self.where.label
                tell_once(f"{label}: what it prints is kept in {self._output.name}", f"{label} prints")
            return run

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self.last_output = "\n".join(last_lines(Path(self._output.name), LAST))
            self._end()
            self._process = None

    def _exchange(self, process: subprocess.Popen[bytes], request: bytes, seconds: float) -> Answer:
        """Write a request and read the answer; the file of output begins again.

        `OverdueError`: it was not in time. `UserCodeError`: the code printed too much, has ended, or answered wrongly.
        """
        self._output.truncate(0)
        found: Future[Answer | None] = Future()
        threading.Thread(target=_exchanged, args=(process, request, found), daemon=True).start()
        deadline, is_done = monotonic() + seconds, False
        while not is_done:
            is_done = bool(wait([found], max(0.0, min(POLL, deadline - monotonic()))).done)
            if os.fstat(self._output.fileno()).st_size > MOST_PRINTED:
                what = f"it printed more than {MOST_PRINTED / 1e6:g} MB in a run"
                raise UserCodeError(f"{what}; take the prints out{self._printed}")
            if not is_done and monotonic() >= deadline:
                remedy = "make it faster, or give a longer --timeout"
                raise OverdueError(f"it was not done after {seconds:g} s; {remedy}{self._printed}")
        answer = found.result()
        if answer is None:
            raise UserCodeError(f"{_why_no_answer(process)}{self._printed}")
        return answer

    def _reported(self, error: UserCodeError, beginning: str = "") -> UserCodeError:
        """Return an error of the code with what it printed; a refusal ends with the wrapper."""
        return type(error)(f"{beginning}{error}{'' if isinstance(error, FormError) else self._printed}")

    @property
    def _printed(self) -> str:
        """The end of an error message: the first lines of output, and where all are; empty if nothing was printed."""
        content = Path(self._output.name).read_bytes()[: 10 * FIRST * WIDEST]
        lines = [printable(each)[:WIDEST] for each in content.decode(errors="replace").splitlines() if each.strip()]
        place = "" if self.limits.is_walled else f"; all in {self._output.name}"
        return f" (it printed first: {' / '.join(lines[:FIRST])}{place})" if any(lines[:FIRST]) else ""


shared_host = lru_cache(maxsize=16)(Host)  # all runs of a study in this process use the same


def _exchanged(process: subprocess.Popen[bytes], request: bytes, found: Future[Answer | None]) -> None:
    """Write a request and read the answer in a thread, because neither has a time limit."""
    assert process.stdin is not None and process.stdout is not None
    try:
        with suppress(OSError):  # the answer, or that it is missing, tells more
            process.stdin.write(request)
            process.stdin.flush()
        found.set_result(read_answer(process.stdout))
    except UserCodeError as error:
        found.set_exception(error)
    except (OSError, ValueError):  # the pipes were closed meanwhile
        found.set_result(None)


def _why_no_answer(process: subprocess.Popen[bytes]) -> str:
    try:
        status = process.wait(ENDING)
    except subprocess.TimeoutExpired:
        return "its process closed the pipe of its answers"
    number = -status if status < 0 else status - 128  # bwrap adds 128
    if number in {*signal.Signals}:
        return f"its process was ended by {signal.Signals(number).name}"
    return f"its process ended with status {status} before the run was done"


def _end(process: subprocess.Popen[bytes], output: IO[bytes], *, is_kept: bool) -> None:
    """End a process with all that it has started, and remove its output if it is empty or not kept."""
    end_group(process)
    is_empty = os.fstat(output.fileno()).st_size == 0
    output.close()
    if is_empty or not is_kept:
        Path(output.name).unlink(missing_ok=True)
