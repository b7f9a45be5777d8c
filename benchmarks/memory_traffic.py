"""Bytes and floating-point operations of a filter step, against what this machine can do: one table.

    python benchmarks/memory_traffic.py [--landmarks 20,100,300,1000]

For n = 3 + 2 L state entries and k = 2 m rows of observations, taken in b rows at a time, one step of the
standard filter moves

    prediction    3 n entries read, 2 n written            (robot rows alone)
    projection    H P: 5 k n entries read, k n written, of which 2 m columns of P come a cache line each
    solve         k n entries read and written             (triangular, in blocks that stay in cache)
    update        n^2 / 2 entries read and written         (the upper triangle), k / b times

and computes b k n / 2 (solve) and k n^2 / 2 (update) multiply-adds. The machine is measured by adding to
an array larger than its caches (bandwidth) and by a large symmetric product (multiply-adds a second).
"""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads

pin_blas_threads()

import argparse
from importlib import import_module
from time import perf_counter

import numpy as np

from slamgauge import simulate
from slamgauge.compare.bench.step_times import workload
from slamgauge.ekf import ekf_slam
from slamgauge.ekf.maps.correction_table import BLOCK


def bandwidth() -> float:
    """Bytes a second of reading and writing an array of 256 MB, best of five."""
    array = np.zeros(2**25)
    best = np.inf
    for _ in range(5):
        start = perf_counter()
        array += 1.0
        best = min(best, perf_counter() - start)
    return 2 * array.nbytes / best


def multiply_add_rate() -> float:
    """Multiply-adds a second of a symmetric product W'W for W (256, 2048), best of five."""
    W = np.asfortranarray(np.random.default_rng(0).standard_normal((256, 2048)))
    blas = import_module("scipy.linalg.blas")  # its stubs do not name dsyrk
    best = np.inf
    for _ in range(5):
        start = perf_counter()
        blas.dsyrk(1.0, W, trans=True)
        best = min(best, perf_counter() - start)
    return 256 * 2048**2 / 2 / best


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--landmarks", default="20,100,300,1000")
    options = parser.parse_args()
    bytes_a_second, rate = bandwidth(), multiply_add_rate()
    print(f"machine: {bytes_a_second / 1e9:.1f} GB/s, {rate / 1e9:.1f} G multiply-adds/s, one thread; times in ms")
    titles = ("landmarks", "k", "MB moved", "of it P", "at bandwidth", "M mult-adds", "at full rate", "measured")
    print(" ".join(f"{title:>12}" for title in titles))
    for size in map(int, options.landmarks.split(",")):
        _, recording = simulate(workload(size), 0)
        estimate = ekf_slam(recording)
        assert estimate.seconds is not None
        assert estimate.nis_dof is not None
        half = recording.steps // 2
        k, n = float(np.median(estimate.nis_dof[half:])), 3 + 2 * size
        block = min(k, 2.0 * BLOCK)
        triangle = 8.0 * n * n * np.ceil(k / block)
        moved = 8.0 * (5 * n + 6 * k * n + 2 * k * n) + 64.0 * (k / 2) * (n / 2) + triangle
        operations = block * k * n / 2 + k * n * n / 2
        cells = (
            f"{k:.0f}",
            f"{moved / 1e6:.3f}",
            f"{triangle / 1e6:.3f}",
            f"{moved / bytes_a_second * 1e3:.4f}",
            f"{operations / 1e6:.3f}",
            f"{operations / rate * 1e3:.4f}",
            f"{np.median(estimate.seconds[half:]) * 1e3:.4f}",
        )
        print(" ".join(f"{cell:>12}" for cell in (size, *cells)), flush=True)


if __name__ == "__main__":
    main()
