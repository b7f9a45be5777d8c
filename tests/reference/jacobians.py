"""Jacobians by differences, to check analytic Jacobians."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from slamgauge.arrays import Float
from slamgauge.se2 import wrap


def differentiate(
    function: Callable[[Float], Float], at: ArrayLike, step: ArrayLike = 1e-3, angles: Sequence[int] = ()
) -> Float:
    """Compute the Jacobian (m, n) of `function` (n,) -> (m,) by fourth-order central differences.

    Args:
        step: for each argument, or for all. A thousandth of the length over which the function changes its slope
            balances truncation (step^4) and rounding.
        angles: rows of the result that are angles [rad]; their differences are wrapped.
    """
    at = np.asarray(at, dtype=np.float64)
    columns: list[Float] = []
    for i, h in enumerate(np.broadcast_to(step, at.shape)):
        offset = np.zeros_like(at)
        offset[i] = h
        near = function(at + offset) - function(at - offset)
        far = function(at + 2 * offset) - function(at - 2 * offset)
        for row in angles:
            near[row], far[row] = wrap(near[row]), wrap(far[row])
        columns.append((8 * near - far) / (12 * h))
    return np.column_stack(columns)


def assert_jacobian(
    function: Callable[[Float], Float],
    jacobian: ArrayLike,
    at: ArrayLike,
    *,
    step: ArrayLike = 1e-3,
    angles: Sequence[int] = (),
    tolerance: float = 1e-9,
) -> None:
    """Check that `jacobian` is the derivative at `at`, each row to `tolerance` of its largest entry (at least 1)."""
    expected = differentiate(function, at, step, angles)
    actual = np.asarray(jacobian, dtype=np.float64)
    assert actual.shape == expected.shape
    scale = np.maximum(1.0, np.abs(expected).max(axis=1, keepdims=True))
    np.testing.assert_allclose(actual / scale, expected / scale, rtol=0, atol=tolerance)
