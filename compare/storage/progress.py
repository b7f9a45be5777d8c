"""How far work is: a bar on terminals and in notebooks, sparse lines with the time that is left in log files."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from time import monotonic
from types import TracebackType
from typing import Protocol, Self, TypeVar

from tqdm import tqdm

T = TypeVar("T")

FIRST, FACTOR = 30.0, 1.5  # s until the first line of a log file, and by how much longer each next one waits


class Progress(Protocol):
    """What tells how far work is."""

    def update(self) -> object:
        """One more is done."""
        ...

    def set_description(self, text: str, /) -> object:
        """What is being done."""
        ...

    def __enter__(self) -> Self:
        """Begin."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> object:
        """End."""
        ...


def counted(total: int, unit: str, text: str = "", done: int = 0, *, leave: bool = False) -> Progress:
    """A count of `total` things, of which `done` are done already; `leave` keeps the bar when all are."""
    if sys.stderr.isatty() or is_notebook():
        return tqdm(total=total, initial=done, unit=unit, desc=text or None, leave=leave, file=sys.stderr)
    return LogLines(total, unit, text, done)


def tracked(items: Iterable[T], total: int, unit: str, text: str = "", *, leave: bool = False) -> Iterator[T]:
    """The items, and how far their user is."""
    with counted(total, unit, text, leave=leave) as progress:
        for item in items:
            yield item
            progress.update()


def is_notebook() -> bool:
    """Whether this is the kernel of a notebook, which shows bars although it is no terminal."""
    return "ipykernel" in sys.modules


class LogLines:
    """A line now and then, ever more rarely, on a standard error that is no terminal."""

    def __init__(
        self, total: int, unit: str, text: str = "", done: int = 0, clock: Callable[[], float] = monotonic
    ) -> None:
        self._total, self._unit, self._text = total, unit, text
        self._begun_with = self._done = done
        self._clock, self._start, self._wait = clock, clock(), FIRST

    def update(self) -> None:
        """One more is done: a line if it is time for one."""
        self._done += 1
        gone = self._clock() - self._start
        if gone < self._wait or self._done >= self._total:
            return
        self._wait = gone * FACTOR
        left = gone / (self._done - self._begun_with) * (self._total - self._done)
        what = f"{self._text}: " if self._text else ""
        print(f"{what}{self._done} of {self._total} {self._unit}s, about {duration(left)} left", file=sys.stderr)

    def set_description(self, text: str, /) -> None:
        """What is being done."""
        self._text = text

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass


def duration(seconds: float) -> str:
    """A rough length of time in words: 40 s, 3 min, 2.5 h."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
