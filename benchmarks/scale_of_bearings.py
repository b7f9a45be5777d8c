"""Why the maps of bearing-only filters come out too large: one table.

    python benchmarks/scale_of_bearings.py [--runs 12] [--steps 5000] [--scenario q4-ring] [--seed 0] [--speeds 0.3]

The same noise of speed [m/s] and turn, once in what the odometry tells of a path that is driven as commanded (as in all
scenarios), once in the path, of which the odometry tells the command. For every filter: by how much the map is too
large, mean over the runs with its standard error and scatter from run to run [%], and the number of steps after which
the mean is as large as the scatter, which falls with the root of the steps; - where the mean may be zero.
"""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads

pin_blas_threads()

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))  # Python may be told not to look there

from referees.map_scale import too_large

from slamgauge import Estimate, Recording, Truth, batch, load_scenario, simulate
from slamgauge.compare.scenarios.observation_simulation import Streams, observe
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.ekf.estimators import ekf_slam, iekf, riekf
from slamgauge.ekf.settings.initialisation import Delayed, InverseDepth
from slamgauge.se2 import chain

ESTIMATORS: dict[str, Callable[[Recording], Estimate]] = {
    "ekf inverse-depth": lambda recording: ekf_slam(recording, initialisation=InverseDepth()),
    "iekf inverse-depth": lambda recording: iekf(recording, initialisation=InverseDepth()),
    "riekf inverse-depth": lambda recording: riekf(recording, initialisation=InverseDepth()),
    "riekf delayed": lambda recording: riekf(recording, initialisation=Delayed()),
    "batch": batch,
}

KEPT = ("stamps", "prior_mean", "prior_cov", "odometry_cov", "sensor")


def noise_in_the_path(scenario: Scenario, truth: Truth, recording: Recording, seed: int) -> tuple[Truth, Recording]:
    """The run in which the robot errs, and not its odometry."""
    command = scenario.trajectory.increments(scenario.prior.mean)
    assert truth.poses is not None
    assert truth.landmarks is not None
    poses = chain(truth.poses[0], 2.0 * command - recording.odometry)
    streams = Streams(*np.random.SeedSequence(seed).spawn(len(Streams._fields)))
    seen = observe(poses, truth.landmarks, scenario.sensor, streams)
    driven = Recording(
        **{field: getattr(recording, field) for field in KEPT},
        odometry=command,
        observation_step=seen.step,
        observation=seen.value,
        observation_cov=seen.cov,
        landmark=seen.landmark,
    )
    return Truth(poses=poses, landmark_ids=truth.landmark_ids, landmarks=truth.landmarks), driven


def size_of_map(estimate: Estimate, truth: Truth) -> float:
    """By how much the map is larger than the true one [%]."""
    assert truth.landmarks is not None
    assert estimate.landmarks is not None
    assert estimate.landmark_ids is not None
    return too_large(estimate.landmarks, truth.landmarks[estimate.landmark_ids])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=12)
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--scenario", default="q4-ring")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--speeds", default="0.3")
    options = parser.parse_args()
    print(f"{'noise of speed in':18} {'estimator':20} {'size %':>14} {'scatter %':>9} {'equal after steps':>17}")
    for speed in options.speeds.split(","):
        path = f"trajectory.duration={options.steps * load_scenario(options.scenario).trajectory.step}"
        scenario = load_scenario(options.scenario, ["start=sampled", f"motion.sigma_speed={speed}", path])
        for where in ("odometry", "path"):
            sizes: dict[str, list[float]] = {name: [] for name in ESTIMATORS}
            for run in range(options.runs):
                truth, recording = simulate(scenario, options.seed + run)
                if where == "path":
                    truth, recording = noise_in_the_path(scenario, truth, recording, options.seed + run)
                for name, estimator in ESTIMATORS.items():
                    sizes[name].append(size_of_map(estimator(recording), truth))
            for name, found in sizes.items():
                mean, scatter = np.mean(found), np.std(found, ddof=1)
                size = f"{mean:.2f} ± {scatter / np.sqrt(options.runs):.2f}"
                proven = abs(mean) > 2.0 * scatter / np.sqrt(options.runs)
                equal = f"{options.steps * (scatter / mean) ** 2:.0f}" if proven else "-"
                print(f"{speed + ' m/s, ' + where:18} {name:20} {size:>14} {scatter:9.2f} {equal:>17}", flush=True)


if __name__ == "__main__":
    main()
