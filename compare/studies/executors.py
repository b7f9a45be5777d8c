"""Executors for runs: worker processes of this machine, and a Dask cluster of many machines.

Anyone who can reach a Dask scheduler can run code on its workers and on this machine: its messages are pickles. Use
only addresses that no one else can reach, or `tls://`.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import re
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from slamgauge.blas_threads import pin_blas_threads
from slamgauge.errors import UserError

if TYPE_CHECKING:
    from distributed import Client

P = ParamSpec("P")
T = TypeVar("T")

WAIT = 0.5  # s until an interrupt is noticed at the latest
CONNECT = 10.0  # s to wait for a Dask scheduler
WORKERS = 5.0  # s to wait for its first worker
SAME = {"slamgauge": 4, "python": 2, "distributed": 3, "numpy": 3}  # parts of versions that workers must share


class _Processes(Executor):
    """Worker processes, each with a pipe and a thread of its own: one that dies loses its own run, and is replaced.

    An interrupt may leave locks of this process locked, and half a result in a pipe. Python's ProcessPoolExecutor then
    waits for ever; `terminate` waits for neither.
    """

    def __init__(self, jobs: int) -> None:
        os.environ.setdefault("PYTHONSAFEPATH", "1")  # workers must not import libraries from the current folder
        self._tasks = SimpleQueue[tuple[Future[Any], Any] | None]()
        self._workers = set[SpawnProcess]()
        self._starting, self._is_over = threading.Lock(), False
        self._threads = [threading.Thread(target=self._serve, daemon=True) for _ in range(jobs)]
        for each in self._threads:
            each.start()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Submit a run."""
        future = Future[T]()
        self._tasks.put((future, (fn, args, kwargs)))
        return future

    def _serve(self) -> None:
        """Give runs to a worker, one after the other, until there are no more."""
        pipe: Connection | None = None
        while (task := self._tasks.get()) is not None:
            future, call = task
            if self._is_over:
                future.cancel()
            if not future.set_running_or_notify_cancel():
                continue
            try:
                pipe = pipe or self._started()
                pipe.send(call)
                is_done, result = pipe.recv()
            except (EOFError, OSError):
                pipe, is_done, result = None, False, BrokenExecutor("a worker process died")
            except Exception as error:  # noqa: BLE001 it cannot be pickled
                is_done, result = False, error
            future.set_result(result) if is_done else future.set_exception(result)
        if pipe is not None:
            pipe.close()

    def _started(self) -> Connection:
        """Start a process and return the pipe to it."""
        context = multiprocessing.get_context("spawn")  # a fork would inherit BLAS threads and locks
        ours, theirs = context.Pipe()
        with self._starting, theirs:
            if self._is_over:
                raise EOFError
            worker = context.Process(target=_work, args=(theirs,))
            worker.start()
            self._workers.add(worker)
        return ours

    def terminate(self) -> None:
        """Kill the processes."""
        with self._starting:
            self._is_over = True
            for worker in self._workers:
                worker.kill()
                worker.join()
        self.shutdown(wait=False)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes when they are idle."""
        self._is_over = self._is_over or cancel_futures
        for _ in self._threads:
            self._tasks.put(None)
        if wait:
            for each in (*self._threads, *self._workers):
                each.join()


def _work(pipe: Connection) -> None:
    """Answer calls until the pipe ends; a worker ignores interrupts, which its parent handles, and ends with it."""
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=lambda: (parent.join(), os._exit(1)), daemon=True).start()
    with suppress(EOFError, ConnectionError):
        while True:
            function, args, kwargs = pipe.recv()
            try:
                pipe.send((True, function(*args, **kwargs)))
            except BaseException as error:  # noqa: BLE001 the parent raises it
                error.add_note(traceback.format_exc())
                pipe.send((False, error))


def first_done(pending: Iterable[Future[T]]) -> set[Future[T]]:
    """Wait for a run, in short waits: Python may notice an interrupt only when a wait ends."""
    while not (done := wait(pending, WAIT, FIRST_COMPLETED).done):
        pass
    return done


def lost_worker(error: BaseException | None) -> bool:
    """Whether a run is missing because its worker process has died."""
    scheduler = sys.modules.get("distributed.scheduler")  # loaded if the executor is a cluster
    return isinstance(error, BrokenExecutor) or (scheduler is not None and isinstance(error, scheduler.KilledWorker))


@contextmanager
def local_processes(jobs: int) -> Generator[Executor]:
    """Context manager: worker processes on this machine, each with one BLAS thread; they end with their parent.

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
    pool.shutdown(cancel_futures=True)


@contextmanager
def dask_cluster(address: str) -> Generator[Executor]:
    """Context manager: a running Dask cluster, whose workers need the same version of slamgauge.

    Raises:
        UserError: the extra `cluster` is not installed, the address is not valid, no scheduler answers, it has no
            workers or workers of another version, or the connection is lost.
    """
    try:
        from distributed import Client
    except ImportError:
        raise UserError(
            "scheduler: needs the extra 'cluster'; in a clone of slamgauge run: pip install '.[cluster]'"
        ) from None
    if not re.fullmatch(r"(tcp|tls)://\S+:\d+", address):
        raise UserError(f"scheduler {address!r} is not an address; give tcp://host:port or tls://host:port")
    with _quiet():
        try:
            client = Client(address, timeout=CONNECT, set_as_default=False)
        except (OSError, ValueError, TypeError, RuntimeError) as error:  # TimeoutError is an OSError
            reason = (str(error).strip() or type(error).__name__).splitlines()[0]
            raise UserError(f"scheduler {address}: {reason}; give a running one") from None
        try:
            _require_workers(client, address)
            yield client.get_executor(pure=False)
        except UserError:
            raise
        except Exception as error:
            if client.status == "running" and not isinstance(error, CancelledError):
                raise
            raise UserError(f"scheduler {address}: lost; start it again, and give the same command again") from None
        finally:
            client.close()


def _require_workers(client: Client, address: str) -> None:
    """Refuse a cluster that has no workers, or workers of other versions."""
    try:
        client.wait_for_workers(1, timeout=WORKERS)
    except TimeoutError:
        raise UserError(f"scheduler {address}: has no workers; start one: dask worker {address}") from None
    found: Any = client.get_versions(packages=["slamgauge"])
    for worker, theirs in found["workers"].items():
        for name, parts in SAME.items():
            versions = [str(each["packages"][name]).split(".") for each in (theirs, found["client"])]
            there, here = (".".join(each[:parts]) for each in versions)
            if there != here:
                what = f"worker {worker} has {name} {there}, and this is {here}"
                raise UserError(f"scheduler {address}: {what}; install the same on both sides")


@contextmanager
def _quiet() -> Generator[None]:
    """Silence the log of distributed about broken connections, which are also raised as errors."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="distributed")  # about versions, which are checked here
            yield
    finally:
        logging.disable(before)
