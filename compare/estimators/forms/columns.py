"""Columns (n, 1) whose elements convert to numbers, as those of all arrays did before numpy 2.4.

Files of the exercise write `float(u[0])` and `math.sin(x[2])`. What they calculate from a `Column` is a `Column`, too.
"""

from __future__ import annotations

from typing import Any

import numpy as np


class Column(np.ndarray):
    """An array that is a number where one is needed, if it has one element."""

    __array_priority__ = 1.0

    def __float__(self) -> float:
        """Return the only element; raise TypeError if the array has several."""
        return float(_only(self))

    def __int__(self) -> int:
        """Return the only element, rounded towards zero; raise TypeError if the array has several."""
        return int(_only(self))


def column(value: Any) -> Any:
    """Return an array as `Column`; other values, matrices of numpy among them, are returned as they are."""
    return value.view(Column) if type(value) is np.ndarray else value


def _only(array: Column) -> Any:
    if array.size != 1:
        raise TypeError("only arrays of one element can be converted to Python scalars")
    return array.item()
