"""Figures over the defined entries of a series: a gap in the truth is NaN, a figure that does not exist None."""

from __future__ import annotations

import math

import numpy as np

from slamgauge.arrays import Float


def number(value: float) -> float | None:
    """`value` as a Python float, or None where it is NaN or infinite."""
    return float(value) if math.isfinite(value) else None


def mean(values: Float) -> float | None:
    """Mean of the entries that are not NaN; None if there are none or it is infinite."""
    values = values[~np.isnan(values)]
    return number(values.mean()) if values.size else None


def rms(values: Float) -> float | None:
    """Root mean square of the entries that are not NaN; None if there are none or it is infinite."""
    square = mean(np.square(values))
    return None if square is None else math.sqrt(square)
