"""Who carries the runs of a study: processes of this machine, a `concurrent.futures.Executor` (see also `cluster`)."""

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
    """One BLAS thread for this process, if numpy is not imported yet, and for those that it starts.

    Two threads are slower than one on matrices of these sizes. A number that is set already stays.
    """
    for variable in BLAS_VARIABLES:
        os.environ.setdefault(variable, "1")


class _Processes(Executor):
    """Worker processes, begun anew when one of them has died: the runs among them then end with `BrokenExecutor`."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._others = set(multiprocessing.active_children())
        self._pool = self._begin()

    def _begin(self) -> ProcessPoolExecutor:
        os.environ.setdefault("PYTHONSAFEPATH", "1")  # else workers look for libraries in the current folder first
        context = multiprocessing.get_context("spawn")  # a fork would inherit BLAS threads and locks
        return ProcessPoolExecutor(self._jobs, mp_context=context, initializer=_follow_parent)

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Hand out a run, to new processes if the others are gone."""
        try:
            return self._pool.submit(fn, *args, **kwargs)
        except (BrokenExecutor, OSError):  # an OSError if one died while the next was being started
            self.terminate()  # that one would wait for work for ever, and its pool for its end
            self._pool.shutdown()
            self._pool = self._begin()
            return self._pool.submit(fn, *args, **kwargs)

    def terminate(self) -> None:
        """End the processes, whatever they do."""
        for worker in set(multiprocessing.active_children()) - self._others:
            worker.terminate()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes."""
        self._pool.shutdown(wait, cancel_futures=cancel_futures)


def lost_worker(error: BaseException) -> bool:
    """Whether a run is missing because the process that carried it has died."""
    scheduler = sys.modules.get("distributed.scheduler")  # loaded where a cluster carries the runs
    return isinstance(error, BrokenExecutor) or (scheduler is not None and isinstance(error, scheduler.KilledWorker))


@contextmanager
def local_processes(jobs: int) -> Generator[Executor]:
    """Worker processes of this machine, each with one BLAS thread; they end with their parent, however it ends.

    Raises:
        UserError: a worker died, and the caller did not carry on without it.
    """
    pin_blas_threads()
    pool = _Processes(jobs)
    try:
        yield pool
    except BaseException as error:  # what is being computed will not be used any more
        pool.terminate()
        if isinstance(error, BrokenExecutor):
            raise UserError("a worker process died (out of memory?); give the same command again") from None
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _follow_parent() -> None:
    """Leave interrupts to the parent, and end when it is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=lambda: (parent.join(), os._exit(1)), daemon=True).start()
