"""Run every filter for a million steps in a bounded world and print a row for each.

    python benchmarks/soak.py [--steps 1000000] [--only TEXT] [--scenario q4-ring] [--seed 0] [--most 300]

The robot drives the scenario repeatedly, in stretches, so that memory contains only one of them. `--only` selects the
rows with TEXT in their name. The columns are: microseconds per step; landmarks at the end; the smallest eigenvalue
(100 evaluations; a state with an anchor or a clone has eigenvalues that are only rounding) and the largest asymmetry of
the covariance; scale error of the map; growth of resident memory since the first tenth; NEES/3 of the pose in ten bands
of steps. A filter stops when its state has `--most` points.
"""

from __future__ import annotations

from slamgauge.blas_threads import pin_blas_threads

pin_blas_threads()

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import tyro

from slamgauge import Recording, Truth, load_scenario, simulate
from slamgauge.arrays import Float
from slamgauge.ekf import FilterSettings
from slamgauge.ekf.estimators import online_filter
from slamgauge.ekf.maps.correction_table import CORRECTIONS, Correction
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.online_filter import OnlineFilter
from slamgauge.ekf.settings import (
    NEAREST_NEIGHBOUR,
    Association,
    Delayed,
    Initialisation,
    InverseDepth,
    MapManagement,
    Rays,
)
from slamgauge.se2 import wrap

STRETCH = 5000  # steps
BANDS = 10
LOOKS = 100  # evaluations of the whole covariance
EVERY = 10  # steps from one NEES to the next
RANGES = ["sensor.kind=range-bearing", "sensor.sigma_range=0.1"]
INITIALISATIONS: dict[str, Initialisation] = {"fis": Rays(), "inverse-depth": InverseDepth(), "delayed": Delayed()}
ASSOCIATIONS = {
    "nearest-neighbour": NEAREST_NEIGHBOUR,
    "managed neighbour": Association(map_management=MapManagement()),
    "jcbb": Association("jcbb", map_management=MapManagement()),
}


class Row(NamedTuple):
    """A filter and the sensor of its recordings."""

    correction: Correction
    overrides: list[str]
    initialisation: Initialisation = Rays()
    association: Association | None = None


def rows() -> dict[str, Row]:
    """Return every filter: with ranges and ids, without ids, bearing-only, and bearing-only without ids."""
    found = {f"{name} ranges ids": Row(correction, RANGES) for name, correction in CORRECTIONS.items()}
    for name, correction in CORRECTIONS.items():
        for method, association in ASSOCIATIONS.items():
            found[f"{name} ranges {method}"] = Row(correction, RANGES, association=association)
    for way, initialisation in INITIALISATIONS.items():
        for name, correction in CORRECTIONS.items():
            found[f"{name} bearings {way}"] = Row(correction, [], initialisation)
    for method, association in ASSOCIATIONS.items():
        found[f"riekf bearings fis {method}"] = Row("right-invariant", [], association=association)
    return found


def stretches(scenario: str, overrides: list[str], steps: int, seed: int) -> Iterator[tuple[int, Truth, Recording]]:
    """Yield one long run in pieces with the first step of each; a piece begins where the last one ended."""
    seeds = np.random.SeedSequence(seed).generate_state(1 + steps // STRETCH)
    step = load_scenario(scenario, overrides).trajectory.step
    start = ["start=sampled"]
    for first, drawn in zip(range(0, steps, STRETCH), seeds.tolist(), strict=False):
        duration = f"trajectory.duration={min(STRETCH, steps - first) * step}"
        truth, recording = simulate(load_scenario(scenario, [*overrides, *start, duration]), drawn)
        yield first, truth, recording
        assert truth.poses is not None
        start = ["start=mean", f"prior.mean={truth.poses[-1].tolist()}"]


def map_of(slam: OnlineFilter) -> LandmarkMap:
    return next(part for part in vars(slam).values() if isinstance(part, LandmarkMap))


def resident() -> float:
    """Return the resident memory of this process [MB], nan if the system does not report it."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return np.nan
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def scale_error(landmarks: Float, true: Float) -> float:
    """Return by how much [%] a map (L, 2) is larger than the true one: the scale of the best similarity."""
    found, right = (each[:, 0] + 1j * each[:, 1] for each in (landmarks, true))
    found, right = found - found.mean(), right - right.mean()
    return 100.0 * float(abs(np.vdot(right, found)) / np.vdot(right, right).real - 1.0)


def soak(row: Row, scenario: str, steps: int, seed: int, most: int) -> str:
    """Run a filter and return its cells of the table."""
    slam: OnlineFilter | None = None
    nees: list[list[float]] = [[] for _ in range(BANDS)]
    seconds, eigenvalue, asymmetry, memory = 0.0, np.inf, 0.0, np.nan
    step, grown, scale = 0, "", "-"
    overrides = row.overrides + ([] if row.association is None else ["association.method=nearest-neighbour"])
    for first, truth, recording in stretches(scenario, overrides, steps, seed):
        assert truth.poses is not None
        for k, scan in enumerate(recording.scans()):
            if slam is None:
                settings = FilterSettings(row.association or NEAREST_NEIGHBOUR, row.initialisation)
                slam = online_filter(recording, row.correction, settings)
            elif k == 0:  # the last scan of the stretch before
                continue
            step, begin = first + k, time.perf_counter()
            if k > 0:
                slam.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
            if len(scan.value):
                slam.update(scan)
            seconds += time.perf_counter() - begin
            if step % EVERY == 0:
                error, cov = slam.pose - truth.poses[k], slam.pose_cov
                error[2] = wrap(error[2])
                nees[min(step * BANDS // steps, BANDS - 1)].append(error @ np.linalg.solve(cov, error) / 3.0)
                asymmetry = max(asymmetry, float(np.abs(cov - cov.T).max()))
            if step % max(steps // LOOKS, 1) == 0:
                eigenvalue = min(eigenvalue, float(np.linalg.eigvalsh(map_of(slam).state.cov)[0]))
            if len(map_of(slam).state.ids) >= most:
                grown = f"  {most} points at step {step}: stopped"
                break
        if grown:
            break
        memory = resident() if first <= steps // BANDS else memory
        if slam is not None and row.association is None:
            assert truth.landmarks is not None
            scale = f"{scale_error(slam.landmarks, truth.landmarks[slam.landmark_ids]):.2f}"
    assert slam is not None
    cells = f"{1e6 * seconds / max(step, 1):6.0f} {len(slam.landmark_ids):5} {eigenvalue:8.1e} {asymmetry:8.1e}"
    bands = " ".join(f"{np.mean(band):7.2f}" if band else f"{'-':>7}" for band in nees)
    return f"{cells} {scale:>6} {resident() - memory:6.1f} {bands}{grown}"


def main(steps: int = 1_000_000, only: str = "", scenario: str = "q4-ring", seed: int = 0, most: int = 300) -> None:
    width = max(map(len, rows()))
    bands = " ".join(f"{f'..{10 * (band + 1)}%':>7}" for band in range(BANDS))
    print(f"{'filter':{width}} us/step  map  eigenv. asymmetr. size % MB grown {bands}")
    for name, row in rows().items():
        if only in name:
            print(f"{name:{width}} {soak(row, scenario, steps, seed, most)}", flush=True)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
