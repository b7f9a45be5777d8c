"""The account that the compressed filter keeps of its area, compiled; see `slamgauge.ekf.compressed`."""

from __future__ import annotations

from slamgauge.arrays import Float
from slamgauge.compiled import kernel
from slamgauge.ekf.kernels.blas import solve_factor, subtract_gram, subtract_product
from slamgauge.ekf.kernels.workspace import Workspace


@kernel
def account_for_update(count: int, size: int, work: Workspace, T: Float, N: Float, C: Float, g: Float) -> None:
    """Carry the update that `work` describes into the account: T (size, a), C (a, a) and g (a,); N is room."""
    width = C.shape[0]
    for i in range(count):
        landmark = 3 + 2 * work.slots[i]
        for k in (2 * i, 2 * i + 1):
            h = work.jacobian[k]
            for j in range(width):
                N[k, j] = h[0] * T[0, j] + h[1] * T[1, j] + h[2] * T[2, j]
                N[k, j] += h[3] * T[landmark, j] + h[4] * T[landmark + 1, j]
    rows = 2 * count
    solve_factor(work.S, N, rows, width)
    subtract_gram(C, N, rows, width)
    subtract_product(T, work.W, N, rows, size, width)
    for k in range(rows):
        for j in range(width):
            g[j] += N[k, j] * work.innovation[k]
