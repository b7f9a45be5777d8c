"""Checks of the records' constructors (shapes, finite numbers, covariances, indices), and comparison by value.

An invalid value raises ``UserError`` with field, row, value and remedy in one line.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import TypeGuard, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamgauge.arrays import Float, Int, chunks, is_frozen
from slamgauge.covariances import scale_of
from slamgauge.errors import CovarianceError, UserError
from slamgauge.se2 import wrap

LARGEST = 1e50  # largest valid input; products of a few such numbers are still finite
REAL = "fiu"  # kinds of numpy types for real numbers
WHOLE = 2**53  # a double represents all whole numbers below this
Number = TypeVar("Number", np.float64, np.int64)


def store(instance: object, **fields: object) -> None:
    """Store checked fields in a frozen dataclass; arrays become read-only."""
    for name, value in fields.items():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
        object.__setattr__(instance, name, value)


class Record:
    """Base of the records: compared by value, NaN is equal to NaN; not hashable."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other) or not is_dataclass(self):
            return False
        return all(_same(getattr(self, field.name), getattr(other, field.name)) for field in fields(self))


def _same(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=True)
    return type(one) is type(other) and one == other


def as_array(name: str, value: object, shape: tuple[int | None, ...]) -> Float:
    """Return a float64 array with the given shape (None: any length); a copy, unless `value` is read-only."""
    array = value if _is_kept(value, np.float64) else as_numbers(name, value, f"give shape {_spell(shape)}")
    _require_shape(name, array, shape)
    return array


def _is_kept(value: object, dtype: type[Number]) -> TypeGuard[NDArray[Number]]:
    """Return whether records can share an array: it has their type and layout, and is read-only."""
    if not isinstance(value, np.ndarray) or value.dtype != dtype:
        return False
    return value.flags.c_contiguous and value.flags.aligned and is_frozen(value)


def _require_shape(name: str, array: NDArray[np.generic], shape: tuple[int | None, ...]) -> None:
    if array.ndim == len(shape):
        pairs = zip(shape, array.shape, strict=True)
        if all(wanted is None or wanted == given for wanted, given in pairs):
            return
    raise UserError(f"{name}: shape {array.shape} does not fit; give shape {_spell(shape)}")


def as_numbers(name: str, value: object, remedy: str) -> Float:
    """Return a float64 copy of `value`, in any shape; texts and complex numbers are refused."""
    try:
        given = np.asarray(value)
        if given.dtype.kind in f"{REAL}bO":  # numpy converts objects one by one
            return np.array(given, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError):
        pass
    raise UserError(f"{name}: not an array of numbers; {remedy}")


def _spell(shape: tuple[int | None, ...]) -> str:
    sizes = ["any" if n is None else str(n) for n in shape]
    end = "," if len(sizes) == 1 else ""  # as Python prints a tuple of one
    return f"({', '.join(sizes)}{end})"


def as_floats(name: str, value: object, shape: tuple[int | None, ...]) -> Float:
    """Return `as_array` of finite numbers."""
    array = as_array(name, value, shape)
    finite = np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
    require_rows(name, finite, array, "every number must be finite")
    return array


def as_ints(name: str, value: object, shape: tuple[int | None, ...]) -> Int:
    """Return whole numbers as an int64 array; a copy, unless `value` is read-only."""
    rule = "every entry must be a whole number below 2**53"
    if isinstance(value, np.ndarray) and value.dtype == np.int64:  # no conversion to floats: there may be millions
        whole = value if _is_kept(value, np.int64) else np.array(value, order="C")
        _require_shape(name, whole, shape)
        is_small = (whole > -WHOLE) & (whole < WHOLE)
        require_rows(name, is_small, whole, rule)
        return whole
    array = as_floats(name, value, shape)
    is_whole = (array == np.floor(array)) & (np.abs(array) < WHOLE)
    require_rows(name, is_whole, array, rule)
    return array.astype(np.int64)


def as_distinct_ids(name: str, value: object) -> Int:
    """Return ids (n,), >= 0 and distinct, as int64."""
    ids = as_ints(name, value, (None,))
    first = np.zeros(len(ids), dtype=bool)
    first[np.unique(ids, return_index=True)[1]] = True
    require_rows(name, first & (ids >= 0), ids, "ids must be >= 0 and distinct")
    return ids


def as_covariances(name: str, value: object, shape: tuple[int | None, ...], *, definite: bool = False) -> Float:
    """Return positive semi-definite (or definite) matrices, exactly symmetric.

    If all rows are equal, one is stored, and the result is a view of it.

    Raises:
        CovarianceError: a matrix is not a covariance.
    """
    try:
        return _covariances(name, value, shape, definite=definite)
    except UserError as error:
        raise CovarianceError(str(error)) from None


def _covariances(name: str, value: object, shape: tuple[int | None, ...], *, definite: bool) -> Float:
    if isinstance(value, np.ndarray) and value.ndim == 3 and value.dtype.kind in REAL and is_one_for_all(value):
        _require_shape(name, value, shape)
        one = _covariances(name, value[:1].copy(), (1, *shape[1:]), definite=definite)
        one.setflags(write=False)
        return np.broadcast_to(one, value.shape)
    array = as_floats(name, value, shape)
    stack = array.reshape(-1, *array.shape[-2:])
    for rows in chunks(len(stack)):
        given = stack[rows]
        symmetric = _symmetric(name, given, rows.start, definite=definite)
        if not stack.flags.writeable and not np.array_equal(symmetric, given):
            stack = stack.copy()
        if stack.flags.writeable:
            stack[rows] = symmetric
    return stack.reshape(array.shape)


def is_one_for_all(stack: NDArray[np.generic]) -> bool:
    """Return whether all rows (n, ...) are equal; False for fewer than two."""
    if len(stack) < 2 or stack.strides[0] == 0:
        return len(stack) > 1
    return all(bool((stack[rows] == stack[0]).all()) for rows in chunks(len(stack)))


def _symmetric(name: str, stack: Float, first: int, *, definite: bool) -> Float:
    """Return covariances (n, d, d), exactly symmetric; the first has the number `first` in error texts."""
    transposed = stack.swapaxes(1, 2)
    scale = np.abs(stack).max(axis=(1, 2), initial=0.0)
    sigmas = np.sqrt(np.abs(np.diagonal(stack, axis1=1, axis2=2)))
    of_pairs = 1e-9 * sigmas[:, :, None] * sigmas[:, None, :]  # units differ: one tolerance for each pair
    allowed = of_pairs + 1e-15 * scale[:, None, None]
    difference = np.abs(stack / 2 - transposed / 2)
    symmetric = (difference <= allowed / 2).all(axis=(1, 2))
    require_rows(name, symmetric, stack, "a covariance must be symmetric; use (P + P.T) / 2", first)
    stack = stack / 2 + transposed / 2  # halves first: the sum might overflow
    variances = np.diagonal(stack, axis1=1, axis2=2)
    nonnegative = (variances >= -1e-12 * scale[:, None]).all(axis=1)
    require_rows(name, nonnegative, stack, "a covariance must not have a negative variance", first)
    with np.errstate(over="ignore"):
        correlations = np.clip(stack / scale_of(stack), -2.0, 2.0)  # invalid ones may be infinite
    smallest = np.linalg.eigvalsh(correlations)[:, 0]
    require_rows(name, smallest >= -1e-9, stack, "a covariance must not have a negative eigenvalue", first)
    if definite:
        rule = "a covariance must be positive definite here; raise its variances"
        require_rows(name, smallest > 1e-12, stack, rule, first)
    return stack


def are_among(values: Int, ids: Int) -> NDArray[np.bool_]:
    """Return whether each value (n,) is among the ids."""
    found = [np.isin(values[rows], ids) for rows in chunks(len(values))]
    return np.concatenate([np.zeros(0, np.bool_), *found])


def for_all(matrix: object, count: int) -> object:
    """Return a matrix (d, d) as a view (count, d, d); any other value unchanged."""
    try:
        array = np.asarray(matrix)
    except ValueError:  # rows of different lengths, which `as_covariances` refuses
        return matrix
    return np.broadcast_to(array, (count, *array.shape)) if array.ndim == 2 else matrix


def require_type(name: str, value: object, kind: type) -> None:
    """Refuse an argument of another type."""
    if not isinstance(value, kind):
        raise UserError(f"{name}: is of type {type(value).__name__}; give type {kind.__name__}")


def wrap_headings(poses: Float) -> Float:
    """Return poses (n, 3) with wrapped headings; a writable array is changed in place."""
    headings = wrap(poses[:, 2])
    if not poses.flags.writeable:
        if np.array_equal(headings, poses[:, 2], equal_nan=True):
            return poses
        poses = poses.copy()
    poses[:, 2] = headings
    return poses


def require_rows(name: str, good: ArrayLike, rows: NDArray[np.generic], rule: str, first: int = 0) -> None:
    """Refuse the first row that is not good, with field, row (counted from `first`), value and `rule`."""
    bad = np.flatnonzero(np.logical_not(good))
    if len(bad):
        row = bad[0]
        value = np.array2string(np.asarray(rows[row]), precision=6, separator=", ")
        value = value.replace("\n", "")
        raise UserError(f"{name}[{first + row}] = {value}: {rule}")


def as_whole(name: str, value: object, why: str, least: int) -> int:
    """Return a whole number of at least `least` as an int; else refuse it, with the reason `why`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise UserError(f"{name}: {value!r} {why}; give a whole number, at least {least}")
    return int(value)
