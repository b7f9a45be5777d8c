"""Functions of `slamgauge.se2` compiled for kernels: each takes and returns numbers."""

from __future__ import annotations

from slamgauge.jit import callable_in_kernels, inner, kernel
from slamgauge.se2 import exp_xy, log_xy, mean_cos_sin, right_jacobian_entries, wrap_angle

callable_in_kernels(mean_cos_sin)
wrap = kernel(wrap_angle)  # (angle) -> angle
mean_rotation = kernel(mean_cos_sin)  # (turn) -> (cosine, sine) of V(turn)
exp = inner(exp_xy)  # (x, y, turn) -> (x, y)
log = inner(log_xy)  # (x, y, turn) -> (x, y)
right_jacobian = inner(right_jacobian_entries)  # (x, y, turn) -> (j00, j01, j02, j12)
