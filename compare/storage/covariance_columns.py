"""Symmetric matrices as files write them: their upper triangles, row by row (xx xy xt yy yt tt)."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float


def upper_triangles(matrices: Float) -> Float:
    """Upper triangles (n, d (d + 1) / 2) of matrices (n, d, d)."""
    rows, columns = np.triu_indices(matrices.shape[1])
    return matrices[:, rows, columns]


def from_triangles(triangles: Float, size: int) -> Float:
    """Symmetric matrices (n, size, size) of their upper triangles (n, size (size + 1) / 2)."""
    rows, columns = np.triu_indices(size)
    matrices = np.empty((len(triangles), size, size))
    matrices[:, rows, columns] = triangles
    matrices[:, columns, rows] = triangles
    return matrices
