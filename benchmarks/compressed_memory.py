"""What the compressed filter has in memory beyond the covariance of its map: one table.

    python benchmarks/compressed_memory.py [--landmarks 1000,2000,5000,10000] [--correction standard]

A robot sees eighty new landmarks around it, sees them again, and drives on by 20 m, into another area; the filter is
told how many there will be. *P* is the covariance of the whole map, *beyond* what the process has at its most less that
and what it had before, both in GB; with the seconds of the whole drive, and of its longest step.
"""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads

pin_blas_threads()

import argparse
import multiprocessing
import resource
from time import perf_counter

import numpy as np

from slamgauge import CompressedFilter
from slamgauge.ekf.maps.correction_table import Correction
from slamgauge.recording import Observations

SCAN = 80  # landmarks
REACH = 9.0  # [m]
NOISE = np.diag([1e-2, 1e-4])


def resident() -> float:
    """The most memory that this process has had [GB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def drive(correction: Correction, landmarks: int) -> tuple[float, float, float]:
    """Memory beyond the covariance [GB], seconds of the drive, and of its longest step."""
    rng = np.random.default_rng(0)
    prior = np.zeros(3), np.eye(3) * 1e-4
    slam = CompressedFilter("range-bearing", *prior, 10.0, landmarks=landmarks, correction=correction)
    before, seconds = resident(), []
    for first in range(0, landmarks, SCAN):
        ids = np.arange(first, min(first + SCAN, landmarks))
        seen = np.column_stack([rng.uniform(1.0, REACH, len(ids)), rng.uniform(-np.pi, np.pi, len(ids))])
        for _ in range(2):
            values = seen + rng.normal(size=seen.shape) * np.sqrt(np.diag(NOISE))
            start = perf_counter()
            slam.update(Observations(ids, values, np.tile(NOISE, (len(ids), 1, 1))))
            seconds.append(perf_counter() - start)
        slam.predict([20.0, 0.0, 0.02], np.diag([1e-2, 1e-4, 1e-6]))
    assert len(slam.landmark_ids) == landmarks
    return resident() - before - covariance(landmarks), sum(seconds), max(seconds)


def covariance(landmarks: int) -> float:
    """Of robot and landmarks [GB]."""
    return 8e-9 * (3 + 2 * landmarks) ** 2


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--landmarks", default="1000,2000,5000,10000")
    parser.add_argument("--correction", choices=("standard", "right-invariant"), default="standard")
    options = parser.parse_args()
    print(" ".join(f"{title:>11}" for title in ("landmarks", "P [GB]", "beyond [GB]", "drive [s]", "longest [s]")))
    for landmarks in map(int, options.landmarks.split(",")):
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            beyond, total, longest = pool.apply(drive, (options.correction, landmarks))
        cells = (f"{covariance(landmarks):.3f}", f"{beyond:.3f}", f"{total:.2f}", f"{longest:.3f}")
        print(" ".join(f"{cell:>11}" for cell in (landmarks, *cells)), flush=True)


if __name__ == "__main__":
    main()
