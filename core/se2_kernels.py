"""The formulas of `slamgauge.se2`, compiled for kernels: each takes and returns numbers."""

from __future__ import annotations

import math
from typing import Any

from slamgauge.jit import inner, replaced_in_kernels
from slamgauge.se2 import (
    exp_xy,
    half_cotangent,
    jacobian_coefficients,
    log_xy,
    mean_cos_sin,
    right_jacobian_entries,
    wrap_angle,
)


def _half_cotangent(half: Any) -> Any:
    """Return `half_cotangent`, by a series for small turns: that takes a quarter of the time."""
    if abs(half) < 0.05:
        q = half * half
        return 1.0 - q / 3.0 * (1.0 + q / 15.0 * (1.0 + q * 2.0 / 21.0 * (1.0 + q / 10.0)))
    return half / math.tan(half)


def _jacobian_coefficients(turn: Any) -> tuple[Any, Any, Any, Any]:
    """Return `jacobian_coefficients`, by series near 0."""
    if abs(turn) < 1e-2:
        c = 1.0 - turn * turn / 6.0 + turn**4 / 120.0
        s = 0.5 * turn - turn**3 / 24.0 + turn**5 / 720.0
        b = 0.5 - turn * turn / 24.0 + turn**4 / 720.0
        return c, s, turn / 6.0 - turn**3 / 120.0 + turn**5 / 5040.0, b
    c, s = mean_cos_sin(turn)
    return c, s, (turn - math.sin(turn)) / (turn * turn), s / turn


replaced_in_kernels(half_cotangent, _half_cotangent)
replaced_in_kernels(jacobian_coefficients, _jacobian_coefficients)
wrap = inner(wrap_angle)  # (angle) -> angle
mean_rotation = inner(mean_cos_sin)  # (turn) -> (cosine, sine) of V(turn)
exp = inner(exp_xy)  # (x, y, turn) -> (x, y)
log = inner(log_xy)  # (x, y, turn) -> (x, y)
right_jacobian = inner(right_jacobian_entries)  # (x, y, turn) -> (j00, j01, j02, j12)
