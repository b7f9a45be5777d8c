"""Whether batch finds the lowest minimum of bearings alone: its cost against those from other starts.

    python benchmarks/bearing_optimum.py [--scenario q4-ring] [--runs 50] [--seed 0] [--jobs 2]

Of every run batch's cost, and what Levenberg-Marquardt and exact Newton steps reach from dead reckoning, from the
right-invariant filter's path and map, and from the truth. A start that ends lower would show that batch had not found
the optimum. `failed` counts the starts that end nowhere.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from functools import partial

import numpy as np

from slamgauge import load_scenario, local_processes, simulate
from slamgauge.arrays import Float
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.ekf import riekf
from slamgauge.errors import UserError
from slamgauge.graph_baseline import batch, cost
from slamgauge.graph_baseline.gtsam_graph import REGULARISING_NOISE, build_graph, make_values, read_values
from slamgauge.graph_baseline.problem.preparation import landmarks_at_first_sight
from slamgauge.graph_baseline.solver.gtsam_start import levenberg_marquardt
from slamgauge.graph_baseline.solver.levenberg_marquardt import approach, settle
from slamgauge.recording import Recording
from slamgauge.se2 import chain

STARTS = ("dead reckoning", "filter", "truth")
LOWER = 1e-6  # relative: less is rounding


def costs(scenario_name: str, seed: int, run: int) -> list[float]:
    """Batch's cost of a run, then that from each start; not finite where it fails."""
    scenario = load_scenario(scenario_name, ["start=sampled"])
    truth, recording = simulate(scenario, run_seed(seed, run))
    try:
        optimum = batch(recording)
    except UserError:
        return [np.nan] * (1 + len(STARTS))
    assert optimum.association is not None
    assert truth.poses is not None and truth.landmarks is not None
    ids, recording = optimum.landmark_ids, recording.associated(optimum.association)
    reckoned = chain(recording.prior_mean, recording.odometry)
    slam = riekf(recording)
    filtered = landmarks_at_first_sight(recording, slam.poses)
    mapped = np.isin(ids, slam.landmark_ids)
    order = np.argsort(slam.landmark_ids)
    filtered[mapped] = slam.landmarks[order[np.searchsorted(slam.landmark_ids, ids[mapped], sorter=order)]]
    starts = (
        (reckoned, landmarks_at_first_sight(recording, reckoned)),
        (slam.poses, filtered),
        (truth.poses, truth.landmarks[ids]),
    )
    found = [cost(recording, optimum.poses, ids, optimum.landmarks)]
    for poses, landmarks in starts:
        try:
            found.append(_from(recording, poses, landmarks))
        except (UserError, RuntimeError):
            found.append(np.nan)
    return found


def _from(recording: Recording, poses: Float, landmarks: Float) -> float:
    """Cost of the minimum that is reached from a start."""
    assert recording.landmark is not None
    ids = np.unique(recording.landmark)
    values = levenberg_marquardt(build_graph(recording, REGULARISING_NOISE), make_values(poses, ids, landmarks))
    found = settle(recording, ids, approach(recording, ids, *read_values(values)))
    return cost(recording, found.poses, ids, found.landmarks)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="q4-ring")
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    with local_processes(options.jobs) as executor:
        table = np.array([*executor.map(partial(costs, options.scenario, options.seed), range(options.runs))])
    ours = table[:, 0]
    print(f"{options.scenario}, {options.runs} runs: batch failed in {np.isnan(ours).sum()}")
    print(f"{'start':16}{'failed':>8}{'lower':>8}{'equal':>8}{'higher':>8}{'lowest, relative to batch':>28}")
    for name, theirs in zip(STARTS, table[:, 1:].T, strict=True):
        relative = theirs / ours - 1.0
        counts = (np.isnan(relative), relative < -LOWER, np.abs(relative) <= LOWER, relative > LOWER)
        print(f"{name:16}" + "".join(f"{np.sum(each):8d}" for each in counts) + f"{np.nanmin(relative):28.1e}")


if __name__ == "__main__":
    main()
