"""Arrays as slamgauge uses them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Marks = NDArray[np.bool_]

CHUNK = 65_536  # rows that are worked on together: what that takes of memory does not grow with a recording


def select(condition: Any, one: Any, other: Any) -> Any:
    """Return `one` where the condition holds, else `other`: `numpy.where`, which kernels compile to a plain choice."""
    return np.where(condition, one, other)


def chunks(count: int) -> Iterator[slice]:
    """The rows 0..`count` in turn, `CHUNK` of them together."""
    return (slice(first, min(first + CHUNK, count)) for first in range(0, count, CHUNK))


def distinct(values: Int) -> Int:
    """`numpy.unique` of values (n,), without a sorted copy of all of them."""
    found = [np.unique(values[rows]) for rows in chunks(len(values))]
    return np.unique(np.concatenate([values[:0], *found]))


def is_frozen(array: NDArray[np.generic]) -> bool:
    """Whether nobody writes into an array, nor into what it is a view of: then it need not be copied."""
    base = cast("object", array.base)  # bytes, too
    if array.flags.writeable:
        return False
    return is_frozen(base) if isinstance(base, np.ndarray) else base is None or isinstance(base, bytes)


def freeze(*arrays: NDArray[Any]) -> None:
    """Make arrays that are our own read-only, so that records take them as they are."""
    for array in arrays:
        array.setflags(write=False)
