"""Types of arrays, and work on long arrays in chunks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Marks = NDArray[np.bool_]

CHUNK = 65_536  # rows of a chunk: the memory for intermediate arrays does not grow with a recording


def select(condition: Any, one: Any, other: Any) -> Any:
    """Return `one` where the condition is true, else `other`: `numpy.where`; in kernels a plain choice."""
    return np.where(condition, one, other)


def chunks(count: int) -> Iterator[slice]:
    """Yield slices of `CHUNK` rows that cover the rows 0..`count`."""
    return (slice(first, min(first + CHUNK, count)) for first in range(0, count, CHUNK))


def distinct(values: Int) -> Int:
    """Return `numpy.unique` of values (n,), without a sorted copy of all of them."""
    found = [np.unique(values[rows]) for rows in chunks(len(values))]
    return np.unique(np.concatenate([values[:0], *found]))


def is_frozen(array: NDArray[np.generic]) -> bool:
    """Return whether an array and its base are read-only, so that it need not be copied."""
    base = cast("object", array.base)  # bytes are possible
    if array.flags.writeable:
        return False
    return is_frozen(base) if isinstance(base, np.ndarray) else base is None or isinstance(base, bytes)


def freeze(*arrays: NDArray[Any]) -> None:
    """Make arrays read-only, so that records store them without a copy."""
    for array in arrays:
        array.setflags(write=False)
