"""The other end of `isolated`: a fresh interpreter that loads people's code and runs it on recordings.

    python -P -m slamgauge.compare.estimators.isolated_worker REQUESTS ANSWERS

Both are numbers of open files. A line of JSON comes in for each task and one goes out: first the address of the code,
then a word for every run, whose recording lies beside the current folder and whose estimate is left there.
"""

from __future__ import annotations

import io
import json
import os
import resource
import shutil
import signal
import sys
import threading
from base64 import b64decode
from collections.abc import Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout, suppress
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from typing import Any, cast

from slamgauge.compare.estimators.adapters import adapted
from slamgauge.compare.estimators.cpu_time import cpu_seconds
from slamgauge.compare.estimators.discovery import found_in
from slamgauge.compare.estimators.isolated_process import FOLDERS, GIVEN, HERE, MADE
from slamgauge.compare.estimators.landlock import write_only_in
from slamgauge.compare.estimators.sources import Sources
from slamgauge.compare.estimators.user_code import Address, reason_of
from slamgauge.compare.storage.files import load_recording, save
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator

LARGEST_FILE = 500_000_000  # bytes of a file that people's code may write
# bytes of data that its process may take, and each that it starts: ten times what all libraries, filters and optima of
# slamgauge take together, and P of 1000 landmarks is 32 MB
MOST_MEMORY = 4_000_000_000
ENDING = 1.0  # s: what an end takes at most


def main() -> None:
    """Serve one task after the other until there are no more."""
    requests, answers = (int(number) for number in sys.argv[1:3])
    here, folder = Path.cwd(), Path.cwd().parent
    if here.name != HERE or not folder.name.startswith(FOLDERS):
        raise SystemExit("isolated_program: is started by slamgauge alone, in a folder that it will remove")
    _limit(resource.RLIMIT_FSIZE, LARGEST_FILE)
    if sys.platform.startswith("linux"):  # elsewhere it does not count what is mapped, which is nearly all
        _limit(resource.RLIMIT_DATA, MOST_MEMORY)
        with suppress(OSError):
            Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")  # where memory ends, this ends first
    signal.signal(signal.SIGTERM, _leave)
    done = threading.Event()
    follower = threading.Thread(target=_follow_parent, args=[os.getppid(), folder, done], daemon=True)
    follower.start()  # before anything is fenced: this thread may remove the folder, the others may not
    try:
        _serve(requests, answers, folder)
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it ends already
        done.set()
        follower.join(ENDING)


def _serve(requests: int, answers: int, folder: Path) -> None:
    """Load the code, and run it as often as it is asked for."""
    with os.fdopen(requests, encoding="utf-8") as tasks, os.fdopen(answers, "w", encoding="utf-8") as out:
        write_only_in([folder, Path("/dev/null"), Path("/dev/tty"), Path("/dev/shm"), *_caches_of_kernels()])
        _tell(out, {})
        where = _address(json.loads(tasks.readline()))
        sys.argv = [where.place]
        estimator = _loaded(out, where)
        for _ in tasks if estimator is not None else ():
            _tell(out, _run(cast("Estimator", estimator), folder))


def _limit(what: int, most: int) -> None:
    """Limit this process and those that it starts, unless they are limited to less already."""
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


def _loaded(out: Any, where: Address) -> Estimator | None:
    """The estimator; what there is to say of it, or why there is none, is told."""
    heard = io.StringIO()
    try:
        with redirect_stderr(heard):
            found = where if where.attribute else found_in(where)
            estimator = adapted(found)
    except UserError as error:
        sys.stderr.write(heard.getvalue())
        _tell(out, {"reason": str(error)})
        return None
    lines = heard.getvalue().splitlines(keepends=True)
    begin = f"{where.label}: "
    form = lines.pop().removeprefix(begin).strip() if lines and lines[-1].startswith(begin) else ""
    sys.stderr.writelines(lines)
    _tell(out, {"attribute": found.attribute, "form": form})
    return estimator


def _run(estimator: Estimator, folder: Path) -> Mapping[str, object]:
    """Run it on the recording that lies there; what it cost, or why there is no estimate."""
    recording = load_recording(folder / GIVEN)
    (folder / GIVEN).unlink()
    start, cpu = perf_counter(), cpu_seconds()
    try:
        with redirect_stdout(sys.stderr):
            estimate = cast("object", estimator(recording))
        if not isinstance(estimate, Estimate):
            return {"reason": f"returned a {type(estimate).__name__}; return a slamgauge.Estimate"}
    except (Exception, SystemExit) as error:  # noqa: BLE001 whatever people's code raises is told
        most = f"; its process may take {MOST_MEMORY / 1e9:g} GB" if isinstance(error, MemoryError) else ""
        return {"reason": f"{reason_of(error)}{most}"}
    spent = {"seconds": perf_counter() - start, "cpu_seconds": cpu_seconds() - cpu}
    save(folder / MADE, estimate)
    return spent


def _tell(out: Any, answer: Mapping[str, object]) -> None:
    with suppress(OSError, ValueError):  # their code may have closed it
        sys.stderr.flush()
    out.write(json.dumps(answer) + "\n")
    out.flush()


def _address(told: dict[str, Any]) -> Address:
    within = told.pop("sources")
    if within is None:
        return Address(**told)
    files = tuple((path, b64decode(content)) for path, content in within["files"])
    return Address(**told, sources=Sources(within["folder"], within["module"], files))


def _follow_parent(parent: int, folder: Path, done: threading.Event) -> None:
    """Leave nothing behind when the tasks are done, or the process is gone that has started this one, which ends."""
    while os.getppid() == parent and not done.wait(1.0):
        pass
    if not done.is_set():
        os.kill(os.getpid(), signal.SIGTERM)
        done.wait(ENDING)
    shutil.rmtree(folder, ignore_errors=True)
    if not done.is_set():
        os._exit(1)


def _leave(*_: object) -> None:
    """End as an interrupt does: whatever this process has started is ended on the way out."""
    raise KeyboardInterrupt


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        main()
