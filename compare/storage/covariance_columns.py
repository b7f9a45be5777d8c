"""Upper triangles of symmetric matrices, row by row (xx xy xt yy yt tt), as files store covariances."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float


def upper_triangles(matrices: Float) -> Float:
    """Return the upper triangles (n, d (d + 1) / 2) of matrices (n, d, d)."""
    rows, columns = np.triu_indices(matrices.shape[1])
    return matrices[:, rows, columns]


def from_triangles(triangles: Float, size: int) -> Float:
    """Return symmetric matrices (n, size, size) from their upper triangles (n, size (size + 1) / 2)."""
    rows, columns = np.triu_indices(size)
    matrices = np.empty((len(triangles), size, size))
    matrices[:, rows, columns] = triangles
    matrices[:, columns, rows] = triangles
    return matrices
