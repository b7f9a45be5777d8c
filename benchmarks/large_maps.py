"""Full against compressed filter on growing maps: one table.

    python benchmarks/large_maps.py [--landmarks 100,300,1000] [--radius 15]

Milliseconds a step over the second round of the bench workload, all with the settling of the map included: median,
mean, 95 % quantile and the worst step; the largest difference of the two filters' poses; and the allocated memory
over that of the covariance alone.
"""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads

pin_blas_threads()

import argparse
import tracemalloc

import numpy as np

from slamgauge import simulate
from slamgauge.arrays import Float
from slamgauge.compare.bench.bench import workload
from slamgauge.ekf import CompressedFilter, SlamFilter
from slamgauge.ekf.estimators import drive
from slamgauge.recording import Recording


def run(slam: SlamFilter | CompressedFilter, recording: Recording) -> tuple[Float, Float]:
    """Seconds of each step (N+1,) and poses (N+1, 3)."""
    seconds, poses = np.zeros(recording.steps + 1), np.empty((recording.steps + 1, 3))
    for k, step in enumerate(drive(slam, recording)):
        seconds[k], poses[k] = step.seconds, slam.pose
    return seconds, poses


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--landmarks", default="100,300,1000")
    parser.add_argument("--radius", type=float, default=15.0)
    options = parser.parse_args()
    titles = ("landmarks", "filter", "median [ms]", "mean [ms]", "p95 [ms]", "worst [ms]", "difference", "memory/P")
    print(" ".join(f"{title:>11}" for title in titles))
    for size in map(int, options.landmarks.split(",")):
        _, recording = simulate(workload(size), 0)
        prior = recording.sensor, recording.prior_mean, recording.prior_cov
        run(CompressedFilter(*prior, options.radius), simulate(workload(20), 0)[1])  # compiled code loaded
        tracemalloc.start()
        full = SlamFilter(*prior, landmarks=size)
        for k, scan in enumerate(recording.scans()):
            if k > recording.steps // 2:  # every scan's size has been met, so every work array is there
                break
            full.update(scan)
        memory = tracemalloc.get_traced_memory()[0] / (8.0 * (3 + 2 * size) ** 2)
        tracemalloc.stop()
        full = SlamFilter(*prior, landmarks=size)
        reference = np.zeros((0, 3))
        for name, slam in (("full", full), ("compressed", CompressedFilter(*prior, options.radius))):
            seconds, poses = run(slam, recording)
            reference = poses if name == "full" else reference
            second = seconds[recording.steps // 2 :] * 1e3
            figures = np.median(second), second.mean(), np.quantile(second, 0.95), second.max()
            times = (f"{value:.3f}" for value in figures)
            cells = (size, name, *times, f"{np.abs(poses - reference).max():.1e}")
            print(" ".join(f"{cell:>11}" for cell in (*cells, f"{memory:.2f}" if name == "full" else "-")), flush=True)


if __name__ == "__main__":
    main()
