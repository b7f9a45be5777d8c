"""Worker processes of this machine as a `concurrent.futures.Executor` (`cluster`: of many machines)."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

from slamgauge.errors import UserError

P = ParamSpec("P")
T = TypeVar("T")

BLAS_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def pin_blas_threads() -> None:
    """Limit BLAS to one thread in this process, if numpy is not imported yet, and in its child processes.

    Two threads are slower than one on matrices of these sizes. A number that is already set is kept.
    """
    for variable in BLAS_VARIABLES:
        os.environ.setdefault(variable, "1")


class _Processes(Executor):
    """Worker processes, restarted after one has died; the runs of the dead pool end with `BrokenExecutor`."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._others = set(multiprocessing.active_children())
        self._pool = self._begin()

    def _begin(self) -> ProcessPoolExecutor:
        os.environ.setdefault("PYTHONSAFEPATH", "1")  # workers must not import libraries from the current folder
        context = multiprocessing.get_context("spawn")  # a fork would inherit BLAS threads and locks
        return ProcessPoolExecutor(self._jobs, mp_context=context, initializer=_follow_parent)

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Submit a run, to new processes if the others have died."""
        try:
            return self._pool.submit(fn, *args, **kwargs)
        except (BrokenExecutor, OSError):  # OSError: a process died while another started
            self.terminate()  # the other would wait for work for ever, and the pool for its end
            self._pool.shutdown()
            self._pool = self._begin()
            return self._pool.submit(fn, *args, **kwargs)

    def terminate(self) -> None:
        """Kill the processes."""
        for worker in set(multiprocessing.active_children()) - self._others:
            worker.terminate()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes when they are idle."""
        self._pool.shutdown(wait, cancel_futures=cancel_futures)


def lost_worker(error: BaseException) -> bool:
    """Whether a run is missing because its worker process has died."""
    scheduler = sys.modules.get("distributed.scheduler")  # loaded if the executor is a cluster
    return isinstance(error, BrokenExecutor) or (scheduler is not None and isinstance(error, scheduler.KilledWorker))


@contextmanager
def local_processes(jobs: int) -> Generator[Executor]:
    """Start worker processes on this machine, each with one BLAS thread; they end with their parent in all cases.

    Raises:
        UserError: a worker died, and the caller did not handle it.
    """
    pin_blas_threads()
    pool = _Processes(jobs)
    try:
        yield pool
    except BaseException as error:  # running results will not be used
        pool.terminate()
        if isinstance(error, BrokenExecutor):
            raise UserError("a worker process died (out of memory?); give the same command again") from None
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _follow_parent() -> None:
    """Ignore interrupts, which the parent handles, and exit when the parent has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=lambda: (parent.join(), os._exit(1)), daemon=True).start()
