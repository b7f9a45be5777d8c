"""Work of a process with user code: limit the process, load the code, and run it once.

    python -P -m slamgauge.compare.estimators.isolated_worker REQUESTS ANSWERS

starts it behind a wall of `bwrap`; `launcher` forks it. Both numbers are those of open files. A request is the address
of the code; the next one, which comes after the code is loaded, is a recording.
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
from collections.abc import Mapping
from contextlib import redirect_stdout, suppress
from pathlib import Path
from time import perf_counter
from typing import IO, cast

from numpy import random  # imported here, since the import of numpy does not load it, and every run would

from slamgauge.compare.estimators import namespaces
from slamgauge.compare.estimators.adapters import adapted, found_in
from slamgauge.compare.estimators.answers import message, read_address, read_recording
from slamgauge.compare.estimators.cpu_time import cpu_seconds
from slamgauge.compare.estimators.forms.form import remarks_of, replaces_noise
from slamgauge.compare.estimators.landlock import write_only_in
from slamgauge.compare.estimators.user_code import reason_of
from slamgauge.compare.estimators.wall import CACHES, HOME, WRITABLE, caches
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.recording import Recording

LARGEST_FILE = 500_000_000  # bytes of a file that user code may write
# bytes of data of this process, and of each that it starts: ten times what all libraries, filters and optima of
# slamgauge need together; P of 1000 landmarks has 32 MB
MOST_MEMORY = 4_000_000_000
MOST_PROCESSES = 256  # and threads, behind a wall
MOST_OPEN_FILES = 1024


def serve(requests: int, answers: int, home: str, *, walled: bool) -> None:
    """Limit this process to its own files, load user code, and run it on a recording.

    Args:
        requests: open pipe of the address and of the recording.
        answers: open pipe for the form of the code, and for the estimate.
        home: its current, home and temporary folder.
        walled: whether it is behind a wall, where it may count all processes of its user.
    """
    _settle(home)
    limit(resource.RLIMIT_FSIZE, LARGEST_FILE)
    limit(resource.RLIMIT_NOFILE, MOST_OPEN_FILES)
    if sys.platform.startswith("linux"):  # other systems do not count mapped memory, which is nearly all
        limit(resource.RLIMIT_DATA, MOST_MEMORY)
    if walled:
        limit(resource.RLIMIT_NPROC, MOST_PROCESSES)
        namespaces.leave_keys()
    write_only_in([Path(home), Path(os.devnull), *(map(Path, WRITABLE) if walled else ())])
    random.seed()  # noqa: NPY002 a forked process has the state of its parent
    with os.fdopen(requests, "rb") as tasks, os.fdopen(answers, "wb") as out:
        _answer(out, {})
        where = read_address(tasks)
        sys.argv = [where.place]
        try:
            found = where if where.attribute else found_in(where)
            estimator, form = adapted(found)
        except UserError as error:
            _answer(out, {"reason": str(error)})
            return
        _answer(out, {"attribute": found.attribute, "form": form})
        recording = read_recording(tasks)
        if recording is not None:
            _answer(out, *_run(estimator, recording))


def _settle(home: str) -> None:
    """Make a folder the current, home and temporary one; its caches begin with those of the user."""
    for name in CACHES:
        for entry in (caches() / name).glob("*"):
            link = Path(home, ".cache", name, entry.name)
            link.parent.mkdir(parents=True, exist_ok=True)
            link.symlink_to(entry)
    os.chdir(home)
    os.environ.update(HOME=home, TMPDIR=home, PWD=home, XDG_CACHE_HOME=str(Path(home, ".cache")))
    tempfile.tempdir = None


def limit(what: int, most: int) -> None:
    """Limit this process and those that it starts, unless a lower limit exists."""
    least = min(each for each in (*resource.getrlimit(what), most) if each != resource.RLIM_INFINITY)
    resource.setrlimit(what, (least, least))


def _run(estimator: Estimator, recording: Recording) -> tuple[Mapping[str, object], Estimate | None]:
    """Return times and remarks of a run, and its estimate; or why it has no estimate."""
    start, cpu = perf_counter(), cpu_seconds()
    try:
        with redirect_stdout(sys.stderr):
            estimate = cast("object", estimator(recording))
        if not isinstance(estimate, Estimate):
            return {"reason": f"returned a {type(estimate).__name__}; return a slamgauge.Estimate"}, None
    except (Exception, SystemExit) as error:  # noqa: BLE001 user code may raise anything
        most = f"; its process may take {MOST_MEMORY / 1e9:g} GB" if isinstance(error, MemoryError) else ""
        return {"reason": f"{reason_of(error)}{most}"}, None
    spent = {"seconds": perf_counter() - start, "cpu_seconds": cpu_seconds() - cpu}
    fields = {**spent, "remarks": remarks_of(estimator, recording), "replaces_noise": replaces_noise(estimator)}
    return fields, estimate


def _answer(out: IO[bytes], fields: Mapping[str, object], estimate: Estimate | None = None) -> None:
    with suppress(OSError, ValueError):  # user code may have closed it
        sys.stderr.flush()
    out.write(message(fields, estimate))
    out.flush()


def leave(*_: object) -> None:
    """End as at an interrupt, so that `finally` blocks end the programs that this process has started."""
    raise KeyboardInterrupt


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        serve(*map(int, sys.argv[1:3]), HOME, walled=True)  # pyrefly: ignore[bad-argument-count, bad-argument-type]
