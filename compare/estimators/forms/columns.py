"""Arrays of one element as numbers, which numpy refuses since 2.4 and the exercise's files rely on.

`float(u[0])` and `math.sin(x[2])` of columns (n, 1) work for a `Column`, an array with `__float__`. `use_columns` makes
all arrays that a user's module creates columns, too.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from types import ModuleType
from typing import Any

import numpy as np

# functions of numpy whose results would be plain arrays
MAKERS = ("append", "array", "asarray", "atleast_2d", "block", "column_stack", "concatenate", "copy", "diag", "dot")
MAKERS += ("empty", "eye", "hstack", "identity", "matrix", "ones", "ones_like", "vstack", "zeros", "zeros_like")


class Column(np.ndarray):
    """An array that is a number where one is needed, if it has one element."""

    __array_priority__ = 1.0

    def __float__(self) -> float:
        """Return the only element.

        Raises:
            TypeError: it has several.
        """
        return float(_only(self))

    def __int__(self) -> int:
        """Return the only element, rounded towards zero.

        Raises:
            TypeError: it has several.
        """
        return int(_only(self))

    def __sub__(self, other: Any) -> Any:
        """Subtract an array, or a list that may contain arrays of one element."""
        return super().__sub__(_numbers(other) if isinstance(other, list | tuple) else other)


class ColumnMatrix(Column, np.matrix):  # pyrefly: ignore[invalid-inheritance]
    """A matrix of numpy, for which `*` is the product of matrices, with the numbers of `Column`."""

    # above that of `numpy.matrix`, which comes before arrays
    __array_priority__ = 11.0  # pyrefly: ignore[bad-override]


def column(array: Any) -> Any:
    """Return a view of an array as `Column`; other values are returned as they are."""
    if type(array) is np.matrix:
        return array.view(ColumnMatrix)
    return array.view(Column) if type(array) is np.ndarray else array


def use_columns(names: dict[str, Any]) -> None:
    """Replace numpy, and functions imported from it, among the global names of a module."""
    replaced = {getattr(np, name): _maker(getattr(np, name)) for name in MAKERS}
    lenient = ModuleType("numpy", np.__doc__)
    vars(lenient).update(vars(np))
    vars(lenient).update({each.__name__: each for each in replaced.values()})
    for name, value in [*names.items()]:
        if value is np:
            names[name] = lenient
        elif any(value is each for each in replaced):
            names[name] = replaced[value]
        elif isinstance(value, np.ndarray):
            names[name] = column(value)


def _maker(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function of numpy whose results are columns, and that takes arrays of one element within lists."""

    @wraps(function, updated=())
    def made(*arguments: Any, **options: Any) -> Any:
        try:
            return column(function(*arguments, **options))
        except ValueError:
            if not arguments or not isinstance(arguments[0], list | tuple):
                raise
            return column(function(_numbers(arguments[0]), *arguments[1:], **options))

    return made


def _numbers(value: Any) -> Any:
    """Replace arrays of one element within lists by numbers."""
    if isinstance(value, list | tuple):
        return [_numbers(each) for each in value]
    return value.item() if isinstance(value, np.ndarray) and value.size == 1 else value


def _only(array: Column) -> Any:
    if array.size != 1:
        raise TypeError("only arrays of one element can be converted to Python scalars")
    return array.item()
