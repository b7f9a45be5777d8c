"""Cases one after the other in a process that is started again when it dies or hangs."""

from __future__ import annotations

import multiprocessing
import resource
import signal
from collections.abc import Iterable, Iterator
from typing import Any

from fuzzing.cases import CRASH, HANG, Tried, carry_out, target_of

PROCESSES = multiprocessing.get_context("fork")  # what is loaded and compiled stays so


def carry_out_all(seed: int, cases: Iterable[int], seconds: float, memory: int) -> Iterator[tuple[int, Tried]]:
    """Every case and what came of it.

    Args:
        seed: of all of them.
        cases: their numbers.
        seconds: that one may take.
        memory: bytes of data that its process may take.
    """
    left = [*cases]
    while left:
        ours, theirs = PROCESSES.Pipe()
        process = PROCESSES.Process(target=_serve, args=(theirs, seed, left, memory))  # which has children
        process.start()
        theirs.close()
        try:
            while left:
                tried = _next(ours, seconds)
                if tried is None:
                    process.kill()
                    process.join()
                    outcome = HANG if process.exitcode == -signal.SIGKILL else CRASH
                    detail = f"no answer after {seconds:g} s" if outcome == HANG else f"exit code {process.exitcode}"
                    tried = Tried(target_of(seed, left[0]), outcome, detail)
                    yield left.pop(0), tried
                    break
                yield left.pop(0), tried
        finally:
            process.kill()
            process.join()
            ours.close()


def _next(ours: Any, seconds: float) -> Tried | None:
    """What the process says of a case; None if it does not in time, or is gone."""
    try:
        return ours.recv() if ours.poll(seconds) else None
    except EOFError:
        return None


def _serve(answers: Any, seed: int, cases: list[int], memory: int) -> None:
    resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent tells
    for case in cases:
        answers.send(carry_out(seed, case))
