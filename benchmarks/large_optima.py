"""Measure time and memory of the hindsight optimum on growing maps.

    python benchmarks/large_optima.py [--landmarks 1000,2000,5000,10000] [--sights 10]

The robot drives through a field in lanes with about `--sights` landmarks in view, none nearer than
half a metre. The columns are: landmarks, scans and observations; seconds of `batch` with the covariances of all poses
and landmarks; seconds of one linear problem with its covariances, its pieces, and the unknowns of its largest front;
largest memory of the process, Python and libraries included; chi-square over its degrees of freedom. The last lines
give the growth of time and memory from size to size.
"""

from __future__ import annotations

from slamgauge.blas_threads import pin_blas_threads

pin_blas_threads()

import multiprocessing
import resource
from itertools import pairwise
from time import perf_counter
from typing import NamedTuple

import numpy as np
import tyro

from slamgauge import batch, simulate
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.graph_baseline.problem.objective import Objective
from slamgauge.graph_baseline.problem.preparation import prepare
from slamgauge.graph_baseline.solver.levenberg_marquardt import planned_at, scans_of
from slamgauge.graph_baseline.solver.multifrontal import largest
from slamgauge.graph_baseline.solver.smoother import solve

NEAREST = 0.5  # m


class Figures(NamedTuple):
    """A row of the table."""

    landmarks: int
    scans: int
    observations: int
    seconds: float
    one_solution: float  # s
    pieces: int
    front: int
    memory: float  # GB
    misfit: float


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


def measured(landmarks: int, sights: int) -> Figures:
    """Measure one size, in a separate process because the largest memory is that of the whole process."""
    scenario = field(landmarks, sights)
    far = scenario.sensor.model_copy(update={"min_range": NEAREST})
    _, recording = simulate(Scenario.model_validate(scenario.model_copy(update={"sensor": far})), 0)
    batch(recording.first(20))  # loads compiled code
    start = perf_counter()
    estimate = batch(recording)
    seconds = perf_counter() - start
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    assert estimate.landmarks is not None
    assert estimate.chi_square is not None
    assert estimate.chi_square_dof is not None
    objective = Objective(prepare(recording))
    point = objective.at(estimate.poses, estimate.landmarks)
    planned = planned_at(objective, point)
    start = perf_counter()
    solve(point.model, scans_of(objective), planned)
    once = perf_counter() - start
    return Figures(
        planned.landmarks,
        len(np.unique(recording.observation_step)),
        len(recording.observation),
        seconds,
        once,
        len(planned.pieces),
        largest(planned.front),
        memory,
        estimate.chi_square / estimate.chi_square_dof,
    )


def main(landmarks: str = "1000,2000,5000,10000", sights: int = 10) -> None:
    titles = ("landmarks", "scans", "seen", "batch [s]", "one [s]", "pieces", "front", "memory [GB]", "chi2/dof")
    print(" ".join(f"{title:>11}" for title in titles))
    found: list[Figures] = []
    for size in map(int, landmarks.split(",")):
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            one = pool.apply(measured, (size, sights))
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
    tyro.cli(main, description=__doc__)
