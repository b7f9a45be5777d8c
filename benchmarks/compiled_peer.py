"""The standard filter against a numba program with BLAS that a careful user would write, side by side: one table.

    python benchmarks/compiled_peer.py [--landmarks 20,100,300,1000] [--rounds 1]

Median and 95 % quantile of a step in milliseconds over the second round of the bench workload, the two filters taking
turns (of several `--rounds` the shortest time of each step), and the largest difference of their poses in standard
deviations. The other program keeps the whole of P, takes a scan in at once, and leaves every product to BLAS:
the factor U of S = U'U, its inverse, W = U'^-1 H P and P - W'W.
"""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads

pin_blas_threads()

import argparse
from collections.abc import Iterator
from time import perf_counter

import numpy as np
from numba import njit

from slamgauge import Recording, SlamFilter, simulate
from slamgauge.arrays import Float, Int
from slamgauge.compare.bench.step_times import workload
from slamgauge.ekf.estimators import drive


@njit(cache=True)
def predict(state: Float, P: Float, size: int, u: Float, Q: Float) -> None:
    """Move by the increment u (3,) with covariance Q (3, 3)."""
    c, s = np.cos(state[2]), np.sin(state[2])
    moved_x, moved_y = c * u[0] - s * u[1], s * u[0] + c * u[1]
    for j in range(size):
        P[0, j] -= moved_y * P[2, j]
        P[1, j] += moved_x * P[2, j]
    for i in range(size):
        P[i, 0] -= moved_y * P[i, 2]
        P[i, 1] += moved_x * P[i, 2]
    G = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    P[:3, :3] += G @ Q @ G.T
    state[0] += moved_x
    state[1] += moved_y
    state[2] += u[2]


@njit(cache=True)
def update(state: Float, P: Float, size: int, slots: Int, z: Float, R: Float) -> None:
    """Correct with ranges and bearings z (m, 2), with covariances R (m, 2, 2), of the landmarks in `slots` (m,)."""
    m = len(slots)
    W, S, v = np.empty((2 * m, size)), np.empty((2 * m, 2 * m)), np.empty(2 * m)
    H = np.zeros((2 * m, 5))
    for i in range(m):
        k = 3 + 2 * slots[i]
        dx, dy = state[k] - state[0], state[k + 1] - state[1]
        r = np.sqrt(dx * dx + dy * dy)
        turn = z[i, 1] + state[2] - np.arctan2(dy, dx)
        v[2 * i], v[2 * i + 1] = z[i, 0] - r, np.arctan2(np.sin(turn), np.cos(turn))
        h = H[2 * i : 2 * i + 2]
        h[0, 0], h[0, 1], h[0, 3], h[0, 4] = -dx / r, -dy / r, dx / r, dy / r
        h[1, 0], h[1, 1], h[1, 2], h[1, 3], h[1, 4] = dy / r**2, -dx / r**2, -1.0, -dy / r**2, dx / r**2
        for a in range(2):
            for j in range(size):
                W[2 * i + a, j] = h[a, 0] * P[0, j] + h[a, 1] * P[1, j] + h[a, 2] * P[2, j]
            for j in range(size):
                W[2 * i + a, j] += h[a, 3] * P[k, j] + h[a, 4] * P[k + 1, j]
    for a in range(2 * m):
        for b in range(2 * m):
            k, h = 3 + 2 * slots[b // 2], H[b]
            S[a, b] = W[a, 0] * h[0] + W[a, 1] * h[1] + W[a, 2] * h[2] + W[a, k] * h[3] + W[a, k + 1] * h[4]
    for i in range(m):
        S[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] += R[i]
    root = np.linalg.inv(np.linalg.cholesky(S))
    W = root @ W
    state[:size] += (root @ v) @ W
    P[:size, :size] -= W.T @ W


@njit(cache=True)
def augment(state: Float, P: Float, size: int, z: Float, R: Float) -> None:
    """Append the landmark seen at z (2,), with covariance R (2, 2), to the `size` entries in use."""
    c, s = np.cos(state[2] + z[1]), np.sin(state[2] + z[1])
    dx, dy = z[0] * c, z[0] * s
    state[size], state[size + 1] = state[0] + dx, state[1] + dy
    for j in range(size):
        P[size, j] = P[j, size] = P[0, j] - dy * P[2, j]
        P[size + 1, j] = P[j, size + 1] = P[1, j] + dx * P[2, j]
    for a in range(2):
        P[size + a, size] = P[size + a, 0] - dy * P[size + a, 2]
        P[size + a, size + 1] = P[size + a, 1] + dx * P[size + a, 2]
    Jz = np.array([[c, -dy], [s, dx]])
    P[size : size + 2, size : size + 2] += Jz @ R @ Jz.T


def peer(recording: Recording) -> Iterator[tuple[float, Float, Float]]:
    """Seconds, pose (3,) and its covariance (3, 3) after each step of a recording with ranges, bearings and ids."""
    assert recording.landmark is not None
    count = len(np.unique(recording.landmark))
    state, P, size = np.zeros(3 + 2 * count), np.zeros((3 + 2 * count, 3 + 2 * count)), 3
    state[:3], P[:3, :3] = recording.prior_mean, recording.prior_cov
    slot = np.full(int(recording.landmark.max()) + 1, -1)
    for k, (ids, values, covs) in enumerate(recording.scans()):
        start = perf_counter()
        if k > 0:
            predict(state, P, size, recording.odometry[k - 1], np.ascontiguousarray(recording.odometry_cov[k - 1]))
        assert ids is not None
        old = slot[ids] >= 0
        if old.any():
            update(state, P, size, slot[ids[old]], values[old], np.ascontiguousarray(covs[old]))
        for row in np.flatnonzero(~old):
            slot[ids[row]] = (size - 3) // 2
            augment(state, P, size, values[row], np.ascontiguousarray(covs[row]))
            size += 2
        yield perf_counter() - start, state[:3], P[:3, :3]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--landmarks", default="20,100,300,1000")
    parser.add_argument("--rounds", type=int, default=1)
    options = parser.parse_args()
    titles = ("landmarks", "ours [ms]", "p95", "other [ms]", "p95", "ours/other", "difference")
    print(" ".join(f"{title:>11}" for title in titles))
    for size in map(int, options.landmarks.split(",")):
        _, recording = simulate(workload(size), 0)
        prior = recording.sensor, recording.prior_mean, recording.prior_cov
        seconds = np.empty((options.rounds, 2, recording.steps + 1))
        apart = 0.0
        for times in seconds:
            slam = SlamFilter(*prior, landmarks=size)
            for k, (ours, other) in enumerate(zip(drive(slam, recording), peer(recording), strict=True)):
                times[0, k], times[1, k] = ours.seconds, other[0]
                off = slam.pose - other[1]
                off[2] = np.arctan2(np.sin(off[2]), np.cos(off[2]))
                sigma = np.sqrt(np.diag(other[2])) + 1e-15  # none where the start is known exactly
                apart = max(apart, float(np.max(np.abs(off) / sigma)))
        second = seconds[:, :, recording.steps // 2 :].min(axis=0) * 1e3
        median, late = np.median(second, axis=1), np.quantile(second, 0.95, axis=1)
        times = [f"{each:.4f}" for pair in zip(median, late, strict=True) for each in pair]
        cells = (size, *times, f"{median[0] / median[1]:.3f}", f"{apart:.1e}")
        print(" ".join(f"{cell:>11}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
