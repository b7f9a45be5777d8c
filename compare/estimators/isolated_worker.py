"""The program of `isolated_process`: a fresh interpreter that loads user code and runs it on recordings.

    python -P -m slamgauge.compare.estimators.isolated_worker REQUESTS ANSWERS

Both arguments are numbers of open files. The first request is the pickled address of the code; then every line asks for
a run of the recording in the folder above the current one, and the estimate is written there. Each answer is a line of
JSON.
"""

from __future__ import annotations

import json
import os
import pickle
import resource
import shutil
import signal
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import redirect_stdout, suppress
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from typing import Any, cast

from slamgauge.compare.estimators.adapters import adapted, found_in
from slamgauge.compare.estimators.cpu_time import cpu_seconds
from slamgauge.compare.estimators.forms.form import remarks_of, replaces_noise
from slamgauge.compare.estimators.isolated_process import FOLDERS, GIVEN, HERE, MADE
from slamgauge.compare.estimators.landlock import write_only_in
from slamgauge.compare.estimators.user_code import Address, reason_of
from slamgauge.compare.storage.files import load_recording, save
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator

LARGEST_FILE = 500_000_000  # bytes of a file that user code may write
# bytes of data of this process, and of each that it starts: ten times what all libraries, filters and optima of
# slamgauge need together; P of 1000 landmarks has 32 MB
MOST_MEMORY = 4_000_000_000
ENDING = 1.0  # s: largest time for the end of this process


def main() -> None:
    """Limit this process, then serve requests until there are no more."""
    requests, answers = (int(number) for number in sys.argv[1:3])
    here, folder = Path.cwd(), Path.cwd().parent
    if here.name != HERE or not folder.name.startswith(FOLDERS):
        raise SystemExit("isolated_worker: only slamgauge may start it, in a folder that it will remove")
    _limit(resource.RLIMIT_FSIZE, LARGEST_FILE)
    if sys.platform.startswith("linux"):  # other systems do not count mapped memory, which is nearly all
        _limit(resource.RLIMIT_DATA, MOST_MEMORY)
        with suppress(OSError):  # if the machine runs out of memory, the system ends this process first
            Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")
    signal.signal(signal.SIGTERM, _leave)
    done = threading.Event()
    follower = threading.Thread(target=_follow_parent, args=[os.getppid(), folder, done], daemon=True)
    follower.start()  # before Landlock: this thread may remove the folder, user code may not
    try:
        _serve(requests, answers, folder)
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # this process ends already
        done.set()
        follower.join(ENDING)


def _serve(requests: int, answers: int, folder: Path) -> None:
    """Load the code, and run it at each request."""
    with os.fdopen(requests, "rb") as tasks, os.fdopen(answers, "w", encoding="utf-8") as out:
        write_only_in([folder, Path("/dev/null"), Path("/dev/tty"), Path("/dev/shm"), *_caches_of_kernels()])
        _answer(out, {})
        where: Address = pickle.load(tasks)
        sys.argv = [where.place]
        try:
            found = where if where.attribute else found_in(where)
            estimator, form = adapted(found)
        except UserError as error:
            _answer(out, {"reason": str(error)})
            return
        _answer(out, {"attribute": found.attribute, "form": form})
        for _ in tasks:
            _answer(out, _run(estimator, folder))


def _limit(what: int, most: int) -> None:
    """Limit this process and those that it starts, unless a lower limit exists."""
    least = min(each for each in (*resource.getrlimit(what), most) if each != resource.RLIM_INFINITY)
    resource.setrlimit(what, (least, least))


def _caches_of_kernels() -> Iterator[Path]:
    """Yield the folders in which numba stores machine code of slamgauge and of user code."""
    user_wide = Path(os.environ["XDG_CACHE_HOME"], "numba")
    with suppress(OSError):  # without it kernels are compiled in every run
        user_wide.mkdir(parents=True, exist_ok=True)
    yield user_wide
    for name in ("slamgauge", "slamgauge.ekf", "slamgauge.graph_baseline"):
        spec = find_spec(name)
        for place in spec.submodule_search_locations or () if spec is not None else ():
            yield from Path(place).rglob("__pycache__")
    if "NUMBA_CACHE_DIR" in os.environ:
        yield Path(os.environ["NUMBA_CACHE_DIR"])


def _run(estimator: Estimator, folder: Path) -> Mapping[str, object]:
    """Run the estimator on the recording in the folder; return its times and remarks, or why it has no estimate."""
    recording = load_recording(folder / GIVEN)
    (folder / GIVEN).unlink()
    start, cpu = perf_counter(), cpu_seconds()
    try:
        with redirect_stdout(sys.stderr):
            estimate = cast("object", estimator(recording))
        if not isinstance(estimate, Estimate):
            return {"reason": f"returned a {type(estimate).__name__}; return a slamgauge.Estimate"}
    except (Exception, SystemExit) as error:  # noqa: BLE001 user code may raise anything
        most = f"; its process may take {MOST_MEMORY / 1e9:g} GB" if isinstance(error, MemoryError) else ""
        return {"reason": f"{reason_of(error)}{most}"}
    spent = {"seconds": perf_counter() - start, "cpu_seconds": cpu_seconds() - cpu}
    remarks = remarks_of(estimator, recording)
    save(folder / MADE, estimate)
    return {**spent, "remarks": remarks, "replaces_noise": replaces_noise(estimator)}


def _answer(out: Any, answer: Mapping[str, object]) -> None:
    with suppress(OSError, ValueError):  # user code may have closed it
        sys.stderr.flush()
    out.write(json.dumps(answer) + "\n")
    out.flush()


def _follow_parent(parent: int, folder: Path, done: threading.Event) -> None:
    """Wait until the requests are done or the parent process has ended; then end this process and remove the folder."""
    while os.getppid() == parent and not done.wait(1.0):
        pass
    if not done.is_set():
        os.kill(os.getpid(), signal.SIGTERM)
        done.wait(ENDING)
    shutil.rmtree(folder, ignore_errors=True)
    if not done.is_set():
        os._exit(1)


def _leave(*_: object) -> None:
    """End as at an interrupt, so that `finally` blocks end the programs that this process has started."""
    raise KeyboardInterrupt


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        main()
