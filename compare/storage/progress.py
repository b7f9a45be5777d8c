"""Show progress: a bar on terminals and in notebooks, a few lines with the remaining time in log files."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any, Self, TypeVar

from tqdm import tqdm

T = TypeVar("T")

REFRESH = 2.0  # s
FIRST, FACTOR = 30.0, 1.5  # time [s] of the first line in a log file, and factor between the times of lines
FIRST_IN_ITEM = 10.0  # s; the first line while an item runs


def counted(
    total: int, unit: str, text: str = "", done: int = 0, *, alike: bool = True, leave: bool = False
) -> tqdm[Any] | LogLines:
    """Return a progress display of `total` items, `done` of them finished; `leave` keeps the bar at the end.

    The remaining time is shown if the items take about the same time (`alike`).
    """
    if sys.stderr.isatty() or is_notebook():
        form = None if alike else "{desc}{n_fmt}/{total_fmt} |{bar}| {elapsed}"
        return tqdm(
            total=total, initial=done, unit=unit, desc=text or None, leave=leave, file=sys.stderr, bar_format=form
        )
    return LogLines(total, unit, text, done, alike=alike)


def tracked(items: Iterable[T], total: int, unit: str, text: str = "", *, leave: bool = False) -> Iterator[T]:
    """Yield the items and show how many are finished."""
    with counted(total, unit, text, leave=leave) as progress:
        for item in items:
            yield item
            progress.update()


@contextmanager
def refreshed(progress: tqdm[Any] | LogLines, item: Callable[[], str], every: float = REFRESH) -> Generator[None]:
    """Refresh a progress display during an item: its name and the elapsed time."""
    done = threading.Event()

    def refresh() -> None:
        while not done.wait(every):
            progress.set_description(item())
            progress.refresh()

    thread = threading.Thread(target=refresh, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def is_notebook() -> bool:
    """Return whether this is the kernel of a notebook, which shows bars although it is not a terminal."""
    return "ipykernel" in sys.modules


class LogLines:
    """Lines on standard error at growing intervals, for output that is not a terminal."""

    def __init__(
        self,
        total: int,
        unit: str,
        text: str = "",
        done: int = 0,
        *,
        alike: bool = True,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self._total, self._unit, self._text, self._alike = total, unit, text, alike
        self._done = done
        self._clock, self._start, self._wait = clock, clock(), FIRST
        self._wait_in_item = FIRST_IN_ITEM
        self._first: tuple[int, float] | None = None  # items and time [s] at the first of them, which may compile

    def update(self) -> None:
        """Count one finished item, and print a line if it is time."""
        self._done += 1
        gone = self._clock() - self._start
        self._first = self._first or (self._done, gone)
        if gone < self._wait or self._done >= self._total:
            return
        self._wait = gone * FACTOR
        what, left = f"{self._text}: " if self._text else "", ""
        done, since = self._first
        if self._alike and self._done > done:
            seconds = (gone - since) / (self._done - done) * (self._total - self._done)
            left = f", about {duration(seconds)} left"
        print(f"{what}{self._done} of {self._total} {self._unit}s{left}", file=sys.stderr)

    def refresh(self) -> None:
        """Print a line if it is time, while an item runs."""
        gone = self._clock() - self._start
        if gone >= self._wait_in_item:
            self._wait_in_item = gone * FACTOR
            what = f"{self._text}: " if self._text else ""
            print(f"{what}{self._done} of {self._total} {self._unit}s, {duration(gone)}", file=sys.stderr)

    def set_description(self, text: str, /) -> None:
        """Set the text before the counts."""
        self._text = text

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass


def duration(seconds: float) -> str:
    """Return a rounded duration as text: 40 s, 3 min, 2.5 h."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
