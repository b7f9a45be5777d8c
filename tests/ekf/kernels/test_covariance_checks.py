"""The kernels accept the covariances that recordings may have, and refuse indefinite matrices."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf.kernels.soundness import are_sound, is_semidefinite
from slamgauge.errors import UserError
from slamgauge.sensors import SENSORS
from slamgauge.validation import as_covariances
from tests.reference.random_recordings import random_covariances


def spoiled(rng: np.random.Generator, dim: int) -> Float:
    """Return a nearly valid covariance: with rounding errors, zero variances, or invalid entries."""
    root = rng.normal(size=(dim, int(rng.integers(1, dim + 1)))) * 10 ** rng.uniform(-6, 3, (dim, 1))
    root[rng.random(dim) < 0.3] = 0.0
    P, noise = root @ root.T, rng.normal(size=(dim, dim)) * 10 ** rng.uniform(-14, -3)
    noise += noise.T if rng.random() < 0.7 else 0.0
    scale = np.sqrt(np.outer(np.diag(P), np.diag(P))) if rng.random() < 0.5 else 1.0
    return P + noise * scale * (rng.random((dim, dim)) < 0.5)


def is_taken(P: Float, *, definite: bool) -> bool:
    try:
        as_covariances("P", P[None], (1, *P.shape), definite=definite)
    except UserError:
        return False
    return True


def test_kernels_accept_all_covariances_of_recordings() -> None:
    """The kernels accept all that `validation` accepts, and refuse most of those that it refuses."""
    rng, taken, refused = np.random.default_rng(0), 0, 0
    for _ in range(5000):
        Q, R = spoiled(rng, 3), spoiled(rng, 2)
        good = is_taken(Q, definite=False)
        assert is_semidefinite(Q) or not good
        assert are_sound(SENSORS["range-bearing"].code, np.ones((1, 2)), R[None]) or not is_taken(R, definite=True)
        taken, refused = taken + good, refused + (not good and not is_semidefinite(Q))
    assert taken > 1000
    assert refused > 1000
    assert taken + refused > 4500


def test_indefinite_matrices_are_distinguished_from_covariances() -> None:
    rng = np.random.default_rng(1)
    for _ in range(1000):
        Q = random_covariances(rng, 1, 10 ** rng.uniform(-4, 1, 3))[0]
        assert is_semidefinite(Q)
        values, vectors = np.linalg.eigh(Q)
        assert not is_semidefinite(vectors @ np.diag([*values[:2], -values[2]]) @ vectors.T)
