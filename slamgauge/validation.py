"""What the vocabulary's constructors check (shape, finite numbers, covariances, indices), and when values are equal.

A value that does not fit raises ``UserError`` with the field, the row, the value and the remedy in one line.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamgauge.arrays import Float, Int
from slamgauge.correlations import scale_of
from slamgauge.errors import UserError
from slamgauge.se2 import wrap

CHUNK = 65_536  # covariances that are looked at together: what that takes of memory does not grow with a recording
LARGEST = 1e50  # no quantity of a robot is larger; products of some such numbers are still finite
REAL = "fiu"  # kinds of numpy types that are real numbers


def store(instance: object, **fields: object) -> None:
    """Store checked fields in a frozen dataclass; arrays become read-only."""
    for name, value in fields.items():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
        object.__setattr__(instance, name, value)


def equal(one: object, other: object) -> bool:
    """Whether two dataclasses are of the same type and equal field by field; arrays exactly, a gap (NaN) to a gap."""
    if type(one) is not type(other) or not is_dataclass(one):
        return False
    return all(_same(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))


def _same(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=True)
    return type(one) is type(other) and one == other


def as_array(name: str, value: object, shape: tuple[int | None, ...]) -> Float:
    """A float64 copy of `value` with the given shape (None: any length)."""
    array = as_numbers(name, value, f"give shape {_spell(shape)}")
    if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
        raise UserError(f"{name}: shape {array.shape} does not fit; give shape {_spell(shape)}")
    return array


def as_numbers(name: str, value: object, remedy: str) -> Float:
    """A float64 copy of `value` with whatever shape it has; letters are no numbers, nor are complex ones real."""
    try:
        given = np.asarray(value)
        if given.dtype.kind in f"{REAL}bO":  # of objects each is looked at as it becomes a float
            return np.array(given, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError):
        pass
    raise UserError(f"{name}: not an array of numbers; {remedy}")


def _spell(shape: tuple[int | None, ...]) -> str:
    sizes = ["any" if n is None else str(n) for n in shape]
    return f"({', '.join(sizes)}{',' if len(sizes) == 1 else ''})"


def as_floats(name: str, value: object, shape: tuple[int | None, ...]) -> Float:
    """`as_array` of finite numbers."""
    array = as_array(name, value, shape)
    finite = np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
    require_rows(name, finite, array, "every number must be finite")
    return array


def as_ints(name: str, value: object, shape: tuple[int | None, ...]) -> Int:
    """An int64 copy of whole numbers."""
    array = as_floats(name, value, shape)
    whole = (array == np.floor(array)) & (np.abs(array) < 2.0**53)
    require_rows(name, whole, array, "every entry must be a whole number below 2**53")
    return array.astype(np.int64)


def as_distinct_ids(name: str, value: object) -> Int:
    """An int64 copy (n,) of ids that are >= 0 and distinct."""
    ids = as_ints(name, value, (None,))
    first = np.zeros(len(ids), dtype=bool)
    first[np.unique(ids, return_index=True)[1]] = True
    require_rows(name, first & (ids >= 0), ids, "ids must be >= 0 and distinct")
    return ids


def as_covariances(name: str, value: object, shape: tuple[int | None, ...], *, definite: bool = False) -> Float:
    """Symmetric positive semi-definite (or definite) matrices, exactly symmetric on return."""
    array = as_floats(name, value, shape)
    stack = array.reshape(-1, *array.shape[-2:])
    for first in range(0, len(stack), CHUNK):
        rows = slice(first, first + CHUNK)
        stack[rows] = _symmetric(name, stack[rows], first, definite=definite)
    return array


def _symmetric(name: str, stack: Float, first: int, *, definite: bool) -> Float:
    """Covariances (n, d, d), exactly symmetric, of which the first is row `first` of all that were given."""
    transposed = stack.swapaxes(1, 2)
    scale = np.abs(stack).max(axis=(1, 2), initial=0.0)
    sigmas = np.sqrt(np.abs(np.diagonal(stack, axis1=1, axis2=2)))  # units differ: judge each pair by its own
    allowed = 1e-9 * sigmas[:, :, None] * sigmas[:, None, :] + 1e-15 * scale[:, None, None]
    symmetric = (np.abs(stack / 2 - transposed / 2) <= allowed / 2).all(axis=(1, 2))
    require_rows(name, symmetric, stack, "a covariance must be symmetric; use (P + P.T) / 2", first)
    stack = stack / 2 + transposed / 2  # half of each: sums may be more than a double holds
    variances = np.diagonal(stack, axis1=1, axis2=2)
    nonnegative = (variances >= -1e-12 * scale[:, None]).all(axis=1)
    require_rows(name, nonnegative, stack, "a covariance must not have a negative variance", first)
    with np.errstate(over="ignore"):
        correlations = np.clip(stack / scale_of(stack), -2.0, 2.0)  # beyond 1 is no correlation, and may be infinite
    smallest = np.linalg.eigvalsh(correlations)[:, 0]
    require_rows(name, smallest >= -1e-9, stack, "a covariance must not have a negative eigenvalue", first)
    if definite:
        rule = "a covariance must be positive definite here; raise its variances"
        require_rows(name, smallest > 1e-12, stack, rule, first)
    return stack


def for_all(matrix: object, count: int) -> object:
    """One matrix (d, d) as that of all rows (count, d, d); anything else as it is."""
    try:
        array = np.asarray(matrix)
    except ValueError:  # rows of several lengths, which `as_covariances` names
        return matrix
    return np.broadcast_to(array, (count, *array.shape)) if array.ndim == 2 else matrix


def require_type(name: str, value: object, kind: type) -> None:
    """Refuse an argument of another type, by its name."""
    if not isinstance(value, kind):
        raise UserError(f"{name}: is a {type(value).__name__}; give a {kind.__name__}")


def wrap_headings(poses: Float) -> Float:
    """The same poses (n, 3), their headings wrapped in place."""
    poses[:, 2] = wrap(poses[:, 2])
    return poses


def require_rows(name: str, good: ArrayLike, rows: NDArray[np.generic], rule: str, first: int = 0) -> None:
    """Raise for the first row that breaks `rule`, naming field, row (counted from `first`) and value."""
    bad = np.flatnonzero(np.logical_not(good))
    if len(bad):
        value = np.array2string(np.asarray(rows[bad[0]]), precision=6, separator=", ").replace("\n", "")
        raise UserError(f"{name}[{first + bad[0]}] = {value}: {rule}")
