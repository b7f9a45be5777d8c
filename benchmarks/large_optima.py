"""The hindsight optimum of growing maps, each by a process of its own: one table.

    python benchmarks/large_optima.py [--landmarks 1000,2000,5000,10000] [--sights 10]

A field is driven through lane by lane (`large_maps.py`) with about `--sights` landmarks in view, none nearer than half
a metre. Of each size: the landmarks seen, scans and observations; seconds of `batch`, with the covariance of every pose
and landmark; of one linear problem alone with its covariances, its pieces, and the unknowns of its largest front; the
most memory that the process had, Python and libraries included; chi-square over its degrees of freedom. Then how time
and memory grow from size to size.
"""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads

pin_blas_threads()

import argparse
import multiprocessing
import resource
import sys
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parent))  # Python may be told not to look there

import numpy as np
from large_maps import field

from slamgauge import batch, simulate
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.graph_baseline.problem.linearisation import linearise
from slamgauge.graph_baseline.solver.chain_partition import plan
from slamgauge.graph_baseline.solver.motion_elimination import eliminate_motions
from slamgauge.graph_baseline.solver.multifrontal import largest
from slamgauge.graph_baseline.solver.smoother import solve

NEAREST = 0.5  # m


class Figures(NamedTuple):
    """Of one size."""

    landmarks: int
    scans: int
    observations: int
    seconds: float
    one_solution: float  # s
    pieces: int
    front: int
    memory: float  # GB
    misfit: float


def measured(landmarks: int, sights: int) -> Figures:
    """Figures of a field; in a process of its own, for its memory is that of all that went before."""
    scenario = field(landmarks, sights)
    far = scenario.sensor.model_copy(update={"min_range": NEAREST})
    _, recording = simulate(Scenario.model_validate(scenario.model_copy(update={"sensor": far})), 0)
    batch(recording.first(20))  # compiled code loaded
    start = perf_counter()
    estimate = batch(recording)
    seconds = perf_counter() - start
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    assert recording.landmark is not None
    assert estimate.landmarks is not None
    assert estimate.chi_square is not None
    assert estimate.chi_square_dof is not None
    ids, slot = np.unique(recording.landmark, return_inverse=True)
    model = linearise(recording, slot, estimate.poses, estimate.landmarks)
    start = perf_counter()
    solve(model, len(ids))
    once = perf_counter() - start
    planned = plan(eliminate_motions(model), len(ids))
    return Figures(
        len(ids),
        len(np.unique(recording.observation_step)),
        len(recording.observation),
        seconds,
        once,
        len(planned.pieces),
        largest(planned.front),
        memory,
        estimate.chi_square / estimate.chi_square_dof,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--landmarks", default="1000,2000,5000,10000")
    parser.add_argument("--sights", type=int, default=10)
    options = parser.parse_args()
    titles = ("landmarks", "scans", "seen", "batch [s]", "one [s]", "pieces", "front", "memory [GB]", "chi2/dof")
    print(" ".join(f"{title:>11}" for title in titles))
    found: list[Figures] = []
    for size in map(int, options.landmarks.split(",")):
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            one = pool.apply(measured, (size, options.sights))
        found.append(one)
        times = f"{one.seconds:.2f}", f"{one.one_solution:.2f}"
        cells = (*one[:3], *times, one.pieces, one.front, f"{one.memory:.2f}", f"{one.misfit:.3f}")
        print(" ".join(f"{cell:>11}" for cell in cells), flush=True)
    for before, after in pairwise(found):
        growth = np.log(np.array(after) / np.array(before)) / np.log(after.landmarks / before.landmarks)
        each = 1e6 * (after.memory - before.memory) / (after.landmarks - before.landmarks)
        print(
            f"from {before.landmarks} to {after.landmarks}: batch landmarks^{growth[3]:.2f}, one solution "
            f"landmarks^{growth[4]:.2f}, largest front landmarks^{growth[6]:.2f}, {each:.1f} kB a landmark"
        )


if __name__ == "__main__":
    main()
