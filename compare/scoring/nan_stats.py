"""Statistics of the defined entries of a series: undefined entries are NaN, undefined results None."""

from __future__ import annotations

import math

import numpy as np

from slamgauge.arrays import Float


def number(value: float) -> float | None:
    """Return `value` as a Python float, or None if it is NaN or infinite."""
    return float(value) if math.isfinite(value) else None


def defined_mean(values: Float) -> float:
    """Return the mean of the entries that are not NaN, which may be infinite; NaN without entries."""
    values = values[~np.isnan(values)]
    return float(values.mean()) if values.size else math.nan


def mean(values: Float) -> float | None:
    """Return the mean of the entries that are not NaN; None without entries or if it is infinite."""
    return number(defined_mean(values))


def rms(values: Float) -> float | None:
    """Return the root mean square of the entries that are not NaN; None without entries or if it is infinite."""
    square = mean(np.square(values))
    return None if square is None else math.sqrt(square)


def lengths(vectors: Float) -> Float:
    """Return the lengths (n,) of vectors (n, d)."""
    return np.linalg.norm(vectors, axis=1)
