"""Every filter for a million steps round a bounded world: one line each.

    python benchmarks/soak.py [--steps 1000000] [--only TEXT] [--scenario q4-ring] [--seed 0] [--most 300]

The scenario is driven round and round, in stretches, so that no more than one of them is in memory; `--only` takes the
rows whose name holds that text. Of each filter: microseconds a step; landmarks in the end; the smallest eigenvalue (100
looks; what is in the state twice, an anchor or a clone, has none but rounding) and the largest asymmetry that its
covariance ever had; by how much its map is too large; what the resident memory has grown by since the first tenth; and
NEES/3 of the pose in ten bands of steps. A filter stops where its state holds `--most` points.
"""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads
from slamgauge.ekf import FilterSettings

pin_blas_threads()

import argparse
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))  # Python may be told not to look there

from references.map_scale import too_large

from slamgauge import Recording, Truth, load_scenario, simulate
from slamgauge.arrays import Float
from slamgauge.ekf.estimators import online_filter
from slamgauge.ekf.maps.correction_table import CORRECTIONS, Correction
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.online_filter import OnlineFilter
from slamgauge.ekf.settings.association import NEAREST_NEIGHBOUR, Association, MapManagement
from slamgauge.ekf.settings.initialisation import Delayed, Initialisation, InverseDepth, Rays
from slamgauge.se2 import wrap

STRETCH = 5000  # steps
BANDS = 10
LOOKS = 100  # at the whole covariance
EVERY = 10  # steps from one NEES to the next
RANGES = ["sensor.kind=range-bearing", "sensor.sigma_range=0.1"]
INITIALISATIONS: dict[str, Initialisation] = {"fis": Rays(), "inverse-depth": InverseDepth(), "delayed": Delayed()}
ASSOCIATIONS = {
    "nearest-neighbour": NEAREST_NEIGHBOUR,
    "managed neighbour": Association(map_management=MapManagement()),
    "jcbb": Association("jcbb", map_management=MapManagement()),
}


class Row(NamedTuple):
    """A filter and what it is given."""

    correction: Correction
    overrides: list[str]
    initialisation: Initialisation = Rays()
    association: Association | None = None


def rows() -> dict[str, Row]:
    """Every filter by its name: with ranges and ids, without ids, by bearings alone, and by bearings without ids."""
    found: dict[str, Row] = {}
    for name, correction in CORRECTIONS.items():
        found[f"{name} ranges ids"] = Row(correction, RANGES)
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
    """One long run in pieces: the step that each begins at, and where it begins the one before has ended."""
    seeds = np.random.SeedSequence(seed).generate_state(1 + steps // STRETCH)
    step = load_scenario(scenario, overrides).trajectory.step
    start = ["start=sampled"]
    for first, drawn in zip(range(0, steps, STRETCH), seeds.tolist(), strict=False):
        duration = f"trajectory.duration={min(STRETCH, steps - first) * step}"
        truth, recording = simulate(load_scenario(scenario, [*overrides, *start, duration]), drawn)
        yield first, truth, recording
        assert truth.poses is not None
        start = ["start=mean", f"prior.mean={truth.poses[-1].tolist()}"]


@dataclass
class Tally:
    """What is known of a filter's way so far; NEES and how many there were, (BANDS,) each."""

    steps: int
    nees: Float = field(default_factory=lambda: np.zeros(BANDS))
    counts: Float = field(default_factory=lambda: np.zeros(BANDS))
    seconds: float = 0.0
    eigenvalue: float = np.inf
    asymmetry: float = 0.0

    def note_pose(self, step: int, slam: OnlineFilter, pose: Float) -> None:
        """Add the NEES of a step."""
        error, cov = slam.pose - pose, slam.pose_cov
        error[2] = wrap(error[2])
        band = min(step * BANDS // self.steps, BANDS - 1)
        self.nees[band] += error @ np.linalg.solve(cov, error) / 3.0
        self.counts[band] += 1.0
        self.asymmetry = max(self.asymmetry, float(np.abs(cov - cov.T).max()))

    def note_covariance(self, slam: OnlineFilter) -> None:
        """Look at all of the covariance."""
        self.eigenvalue = min(self.eigenvalue, float(np.linalg.eigvalsh(map_of(slam).state.cov)[0]))

    def bands(self) -> str:
        """Mean NEES/3 in each band; - where there was none."""
        means = self.nees / np.maximum(self.counts, 1.0)
        return " ".join(
            f"{mean:7.2f}" if count else f"{'-':>7}" for mean, count in zip(means, self.counts, strict=True)
        )


def map_of(slam: OnlineFilter) -> LandmarkMap:
    """The belief of an online filter."""
    return next(part for part in vars(slam).values() if isinstance(part, LandmarkMap))


def resident() -> float:
    """Memory of this process [MB], where the system tells it."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return np.nan
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def soak(row: Row, scenario: str, steps: int, seed: int, most: int) -> str:
    """Drive a filter; its cells of the table."""
    slam: OnlineFilter | None = None
    tally, step, memory, grown, scale = Tally(steps), 0, np.nan, "", "-"
    overrides = row.overrides + ([] if row.association is None else ["association.method=nearest-neighbour"])
    for first, truth, recording in stretches(scenario, overrides, steps, seed):
        assert truth.poses is not None
        for k, scan in enumerate(recording.scans()):
            if slam is None:
                association = row.association or NEAREST_NEIGHBOUR
                settings = FilterSettings(association, row.initialisation)
                slam = online_filter(recording, row.correction, settings)
            elif k == 0:  # the stretch before has seen it
                continue
            step, begin = first + k, time.perf_counter()
            if k > 0:
                slam.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
            if len(scan.value):
                slam.update(scan)
            tally.seconds += time.perf_counter() - begin
            if step % EVERY == 0:
                tally.note_pose(step, slam, truth.poses[k])
            if step % max(steps // LOOKS, 1) == 0:
                tally.note_covariance(slam)
            if len(map_of(slam).state.ids) >= most:
                grown = f"  {most} points at step {step}: stopped"
                break
        if grown:
            break
        memory = resident() if first <= steps // BANDS else memory
        if slam is not None and row.association is None:
            assert truth.landmarks is not None
            scale = f"{too_large(slam.landmarks, truth.landmarks[slam.landmark_ids]):.2f}"
    assert slam is not None
    cells = f"{1e6 * tally.seconds / max(step, 1):6.0f} {len(slam.landmark_ids):5} {tally.eigenvalue:8.1e}"
    cells += f" {tally.asymmetry:8.1e} {scale:>6} {resident() - memory:6.1f}"
    return f"{cells} {tally.bands()}{grown}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--only", default="")
    parser.add_argument("--scenario", default="q4-ring")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--most", type=int, default=300)
    options = parser.parse_args()
    width = max(map(len, rows()))
    bands = " ".join(f"{f'..{10 * (band + 1)}%':>7}" for band in range(BANDS))
    print(f"{'filter':{width}} us/step  map  eigenv. asymmetr. size % MB grown {bands}")
    for name, row in rows().items():
        if options.only in name:
            cells = soak(row, options.scenario, options.steps, options.seed, options.most)
            print(f"{name:{width}} {cells}", flush=True)


if __name__ == "__main__":
    main()
