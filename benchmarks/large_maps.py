"""Compare the times of the full and the compressed filter on growing maps.

    python benchmarks/large_maps.py [--landmarks 100,300,1000] [--radius 15] [--sights 0]
        [--correction standard]

The columns are: milliseconds per step over the second round of the bench workload, deferred updates included (median,
mean, 95 % quantile, largest); the largest difference between the poses of the two filters; allocated memory divided by
that of the covariance. With `--sights` the robot drives through a field in lanes with about that many landmarks in
view, and the numbers are those of the second half. A star marks the filter that the estimator uses (`ekf`, or `riekf`
with `--correction right-invariant`).
"""

from __future__ import annotations

from slamgauge.blas_threads import pin_blas_threads

pin_blas_threads()

import tracemalloc
from typing import Literal

import numpy as np
import tyro

from slamgauge import simulate
from slamgauge.arrays import Float
from slamgauge.compare.bench.step_times import workload
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.ekf import CompressedFilter, SlamFilter
from slamgauge.ekf.advanced.area_radius import area_that_pays
from slamgauge.ekf.estimators import drive
from slamgauge.recording import Recording


def run(slam: SlamFilter | CompressedFilter, recording: Recording) -> tuple[Float, Float]:
    """Return seconds of each step (N+1,) and poses (N+1, 3)."""
    seconds, poses = np.zeros(recording.steps + 1), np.empty((recording.steps + 1, 3))
    for k, step in enumerate(drive(slam, recording)):
        seconds[k], poses[k] = step.seconds, slam.pose
    return seconds, poses


def field(landmarks: int, sights: int) -> Scenario:
    """Return a square field with a landmark per two square metres, crossed in lanes 4 m apart, 2 m per step."""
    side = np.sqrt(2.0 * landmarks)
    lanes = np.arange(2.0, side, 4.0)
    ends = [((0.0, side) if lane % 2 == 0 else (side, 0.0)) for lane in range(len(lanes))]
    points = [(x, y) for y, both in zip(lanes.tolist(), ends, strict=True) for x in both]
    reach = np.sqrt(2.0 * sights / np.pi)
    return Scenario.model_validate(
        {
            "name": f"field-{landmarks}",
            "description": f"a field of {landmarks} landmarks",
            "trajectory": {"kind": "waypoints", "step": 1.0, "speed": 2.0, "yaw_rate": 4.0, "points": points},
            "motion": {"sigma_speed": 0.01, "sigma_yaw_rate_deg": 0.1},
            "sensor": {"kind": "range-bearing", "max_range": reach, "sigma_range": 0.1, "sigma_bearing_deg": 1.0},
            "landmarks": {"random": {"count": landmarks, "box": (0.0, 0.0, side, side)}},
        }
    )


def main(
    landmarks: str = "100,300,1000",
    radius: float = 15.0,
    sights: int = 0,
    correction: Literal["standard", "right-invariant"] = "standard",
) -> None:
    titles = ("landmarks", "filter", "median [ms]", "mean [ms]", "p95 [ms]", "worst [ms]", "difference", "memory/P")
    print(" ".join(f"{title:>11}" for title in titles))
    for size in map(int, landmarks.split(",")):
        _, recording = simulate(field(size, sights) if sights else workload(size), 0)
        taken = "full" if area_that_pays(recording, correction) is None else "compressed"
        prior = recording.sensor, recording.prior_mean, recording.prior_cov
        compressed = CompressedFilter(*prior, radius, correction=correction)
        run(compressed, simulate(workload(20), 0)[1])  # loads compiled code
        tracemalloc.start()
        full = SlamFilter(*prior, correction, landmarks=size)
        for k, scan in enumerate(recording.scans()):
            if k > recording.steps // 2:  # scans of all sizes have occurred, so all work arrays exist
                break
            full.update(scan)
        memory = tracemalloc.get_traced_memory()[0] / (8.0 * (3 + 2 * size) ** 2)
        tracemalloc.stop()
        full = SlamFilter(*prior, correction, landmarks=size)
        compressed = CompressedFilter(*prior, radius, correction=correction)
        reference = np.zeros((0, 3))
        for name, slam in (("full", full), ("compressed", compressed)):
            seconds, poses = run(slam, recording)
            reference = poses if name == "full" else reference
            second = seconds[recording.steps // 2 :] * 1e3
            figures = np.median(second), second.mean(), np.quantile(second, 0.95), second.max()
            times = (f"{value:.3f}" for value in figures)
            cells = (size, f"{name} *" if name == taken else name, *times, f"{np.abs(poses - reference).max():.1e}")
            print(" ".join(f"{cell:>11}" for cell in (*cells, f"{memory:.2f}" if name == "full" else "-")), flush=True)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
