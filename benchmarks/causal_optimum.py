"""The causal optimum beside GTSAM's iSAM2: time of a step, and distance from the optimum of the measurements so far.

    python benchmarks/causal_optimum.py [--landmarks 20,100] [--steps N] [--prefixes 20] [--log 50000]

The distance is the largest over x, y and heading, in standard deviations, from `batch` on the first steps, at so many
steps spread over the run. The last row is a log at its full odometry rate: --log steps, one in twenty with a scan.
"""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads

pin_blas_threads()

import argparse
from time import perf_counter

import numpy as np

from slamgauge import Estimate, Recording, batch, causal, isam2, simulate
from slamgauge.arrays import Float
from slamgauge.compare.bench.step_times import workload
from slamgauge.se2 import chain, wrap

TITLES = (
    f"{'estimator':16} {'landmarks':>9} {'steps':>7} {'total [s]':>10} {'ms a step':>10} {'off, RMS':>9} {'worst':>8}"
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--landmarks", default="20,100")
    parser.add_argument("--steps", type=int, default=None)
    parser.add_argument("--prefixes", type=int, default=20)
    parser.add_argument("--log", type=int, default=50_000)
    options = parser.parse_args()
    print(TITLES)
    for size in map(int, options.landmarks.split(",")):
        _, recording = simulate(workload(size), 0)
        recording = recording.first(min(options.steps or recording.steps, recording.steps))
        ks = np.unique(np.linspace(1, recording.steps, options.prefixes).astype(int))
        optima = {int(k): batch(recording.first(int(k))) for k in ks}
        for name, estimator in (("causal", causal), ("GTSAM's iSAM2", _isam2)):
            estimator(recording.first(10))
            start = perf_counter()
            poses = estimator(recording).poses
            seconds = perf_counter() - start
            off = np.array([_off(poses[k], optimum) for k, optimum in optima.items()])
            _print(name, size, recording, seconds, f"{np.sqrt(np.mean(off**2)):9.4f} {off.max():8.4f}")
    log = full_rate_log(options.log)
    for name, estimator in (("causal", causal), ("batch", batch)):
        start = perf_counter()
        estimate = estimator(log)
        check = "" if estimate.optimum_check is None else f"{'':9} {estimate.optimum_check:8.4f}"
        _print(name, len(estimate.landmark_ids), log, perf_counter() - start, check)


def _print(name: str, landmarks: int, recording: Recording, seconds: float, off: str) -> None:
    a_step = f"{seconds / recording.steps * 1e3:10.3f}"
    print(f"{name:16} {landmarks:9} {recording.steps:7} {seconds:10.2f} {a_step} {off}", flush=True)


def _isam2(recording: Recording) -> Estimate:
    return isam2(recording, relinearize_threshold=0.05, relinearize_skip=10)


def _off(pose: Float, optimum: Estimate) -> float:
    assert optimum.pose_covs is not None
    apart = pose - optimum.poses[-1]
    apart[2] = wrap(apart[2])
    return float(np.max(np.abs(apart) / np.sqrt(np.diag(optimum.pose_covs[-1]))))


def full_rate_log(steps: int, seed: int = 1, landmarks: int = 15) -> Recording:
    """A winding path at 20 steps a second, with a scan of the four nearest landmarks once a second."""
    rng = np.random.default_rng(seed)
    turns = 0.004 * np.sin(np.arange(steps) / 400) + 0.002
    increments = np.column_stack([np.full(steps, 0.02), np.zeros(steps), turns])
    motion_cov, sight_cov = np.diag([1e-6, 2.5e-7, 1e-6]), np.diag([0.05**2, 0.02**2])
    path = chain([0.0, 0.0, 0.0], increments)[:, :3]
    corners = path[:, :2].min(axis=0) - 5.0, path[:, :2].max(axis=0) + 5.0
    places = rng.uniform(*corners, (landmarks, 2))
    at = np.arange(0, steps + 1, 20)
    offset = places[None] - path[at, None, :2]
    distance = np.hypot(offset[:, :, 0], offset[:, :, 1])
    near = np.argsort(distance, axis=1)[:, :4]
    rows, ids = np.repeat(np.arange(len(at)), 4), near.ravel()
    bearing = np.arctan2(offset[rows, ids, 1], offset[rows, ids, 0]) - path[at[rows], 2]
    sights = np.column_stack([distance[rows, ids], bearing]) + rng.normal(size=(len(rows), 2)) * [0.05, 0.02]
    seen = (distance[rows, ids] > 0.5) & (sights[:, 0] > 0.0)
    return Recording(
        sensor="range-bearing",
        stamps=0.05 * np.arange(steps + 1, dtype=np.float64),
        prior_mean=np.zeros(3),
        prior_cov=np.zeros((3, 3)),
        odometry=increments + rng.normal(size=(steps, 3)) * np.sqrt(np.diag(motion_cov)),
        odometry_cov=np.tile(motion_cov, (steps, 1, 1)),
        observation_step=at[rows][seen],
        observation=np.column_stack([sights[seen, 0], wrap(sights[seen, 1])]),
        observation_cov=np.tile(sight_cov, (int(seen.sum()), 1, 1)),
        landmark=ids[seen],
    )


if __name__ == "__main__":
    main()
