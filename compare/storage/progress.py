"""Progress on standard error: bars on terminals and in notebooks, and a line every half minute in log files."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any

from tqdm import tqdm

INTERVAL = 30.0  # s, before the first line in a log file and between lines


def counted(
    total: int, unit: str, text: str = "", done: int = 0, *, leave: bool = False, items: Iterable[Any] | None = None
) -> tqdm[Any]:
    """Return a progress display of `total` items, `done` of them finished; `leave` keeps the bar at the end.

    It yields the `items`, if given, and counts them.
    """
    is_bar = sys.stderr.isatty() or "ipykernel" in sys.modules  # notebooks show bars
    return tqdm(
        items,
        total=total,
        initial=done,
        unit=unit,
        desc=text or None,
        leave=leave,
        delay=0.0 if is_bar else INTERVAL,
        mininterval=0.1 if is_bar else INTERVAL,
    )
