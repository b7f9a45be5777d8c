"""Repair of covariances as correlations, in any units."""

from __future__ import annotations

import numpy as np

from slamgauge.covariances import without_negative_eigenvalues


def test_rounding_of_a_singular_covariance_is_removed() -> None:
    """Units differ by 1e8, so that the negative eigenvalue is small compared with the largest."""
    units = np.diag([1e4, 1.0, 1e-4])
    direction = np.array([[1.0, 1.0, 0.5]])
    singular = units @ direction.T @ direction @ units
    rounded = singular - 1e-14 * units @ units
    mended = without_negative_eigenvalues(np.stack([rounded, np.zeros((3, 3)), units @ units]))
    np.testing.assert_array_equal(mended, mended.swapaxes(1, 2))
    correlations = np.linalg.inv(units) @ mended @ np.linalg.inv(units)
    assert np.linalg.eigvalsh(correlations).min() >= -1e-15
    np.testing.assert_allclose(correlations, [direction.T @ direction, np.zeros((3, 3)), np.eye(3)], atol=1e-13)
