"""Show progress: a bar on terminals and in notebooks, a few lines with the remaining time in log files."""

from __future__ import annotations

import io
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from tqdm import tqdm

T = TypeVar("T")

REFRESH = 2.0  # s
FIRST, FACTOR = 30.0, 1.5  # time [s] of the first line in a log file, and factor between the times of lines


class LogLines(tqdm):  # pyrefly: ignore[missing-override-decorator, invalid-inheritance]
    """Lines at growing intervals instead of a bar, for output that is not a terminal."""

    due = FIRST  # s after the start

    def display(self, msg: str | None = None, pos: int | None = None) -> None:  # noqa: ARG002 those of tqdm  # pyrefly: ignore
        """Print a line if it is time."""
        state = self.format_dict
        if state["elapsed"] < self.due or self.n >= self.total:
            return
        self.due = FACTOR * state["elapsed"]
        print(self.format_meter(**state), file=sys.stderr)


def counted(
    total: int, unit: str, text: str = "", done: int = 0, *, alike: bool = True, leave: bool = False
) -> tqdm[Any]:
    """Return a progress display of `total` items, `done` of them finished; `leave` keeps the bar at the end.

    The remaining time is shown if the items take about the same time (`alike`).
    """
    is_bar = sys.stderr.isatty() or is_notebook()
    form = None if alike else "{desc}{n_fmt}/{total_fmt} |{bar}| {elapsed}"
    if not is_bar:
        form = f"{{desc}}{{n_fmt}} of {{total_fmt}} {unit}s, {{elapsed}}" + (
            ", about {remaining} left" if alike else ""
        )
    kind = tqdm if is_bar else LogLines
    return kind(
        total=total,
        initial=done,
        unit=unit,
        desc=f"{text}: " if text else None,
        leave=leave,
        file=sys.stderr if is_bar else io.StringIO(),  # lines are printed by `display`
        bar_format=form,
    )


def tracked(items: Iterable[T], total: int, unit: str, text: str = "", *, leave: bool = False) -> Iterator[T]:
    """Yield the items and show how many are finished."""
    with counted(total, unit, text, leave=leave) as progress:
        for item in items:
            yield item
            progress.update()


@contextmanager
def refreshed(progress: tqdm[Any], item: Callable[[], str], every: float = REFRESH) -> Generator[None]:
    """Refresh a progress display during an item: its name and the elapsed time."""
    done = threading.Event()

    def refresh() -> None:
        while not done.wait(every):
            progress.set_description(item())

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
