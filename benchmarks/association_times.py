"""What association costs next to the filter update of the same step, on a growing map: one table.

    python benchmarks/association_times.py [--landmarks 20,100,300,1000] [--observations 10]

Milliseconds a step (median and p95 over the second round of the bench workload, when the map is complete), with
ten observations of each step, drawn at random: joint association (`jcbb`: compatibility, search and ambiguity),
individual compatibility alone, the update with those observations, and the whole step of the nearest neighbour,
which associates and corrects one by one.
"""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads

pin_blas_threads()

import argparse
from time import perf_counter

import numpy as np
from scipy.special import chdtri

from slamgauge import simulate
from slamgauge.arrays import Float
from slamgauge.compare.bench.step_times import workload
from slamgauge.ekf import SlamFilter
from slamgauge.ekf.associating_filter import AssociatingFilter
from slamgauge.ekf.maps.matching import Matcher
from slamgauge.ekf.settings.association import Association, MapManagement
from slamgauge.recording import Observations, Recording

GATE, MANAGEMENT = 9.0, MapManagement()
NODES = Association().node_limit


def some(recording: Recording, observations: int) -> Recording:
    """The recording with so many observations of each step, drawn at random."""
    order = np.lexsort((np.random.default_rng(0).random(len(recording.observation)), recording.observation_step))
    step = recording.observation_step[order]
    rank = np.arange(len(step)) - np.searchsorted(step, step)
    kept = np.zeros(len(step), dtype=bool)
    kept[order[rank < observations]] = True
    return recording.only(kept)


def measure(recording: Recording, observations: int) -> list[Float]:
    """Seconds of each step of the second round: jcbb, compatibility, update, nearest neighbour."""
    slam = SlamFilter(recording.sensor, recording.prior_mean, recording.prior_cov)
    matcher = Matcher(slam.map)
    quantiles = np.concatenate([[0.0], chdtri(2.0 * np.arange(1, observations + 1), 0.0111)])
    times: list[list[float]] = []
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            slam.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
        marks = [perf_counter()]
        _, count = matcher.compatible(scan.value, scan.cov, MANAGEMENT.new_gate)
        marks.append(perf_counter())
        slots = matcher.jointly_compatible(count, GATE, quantiles, NODES)
        matcher.ambiguous(count, GATE, MANAGEMENT.margin, NODES, slots)
        marks.append(perf_counter())
        slam.update(scan)
        marks.append(perf_counter())
        times.append([marks[2] - marks[0], marks[1] - marks[0], marks[3] - marks[2]])
    blind = AssociatingFilter(recording.sensor, recording.prior_mean, recording.prior_cov)
    one_by_one: list[float] = []
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            blind.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
        start = perf_counter()
        blind.update(Observations(None, scan.value, scan.cov))
        one_by_one.append(perf_counter() - start)
    second = slice(recording.steps // 2, None)
    return [*np.array(times)[second].T, np.array(one_by_one)[second]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--landmarks", default="20,100,300,1000")
    parser.add_argument("--observations", type=int, default=10)
    options = parser.parse_args()
    titles = ("jcbb", "compatibility", "update", "nearest neighbour")
    print(f"{'landmarks':>10}" + "".join(f"{title:>21}" for title in titles))
    measure(simulate(workload(20), 0)[1].first(20), options.observations)  # compiled code loaded
    for size in map(int, options.landmarks.split(",")):
        recording = some(simulate(workload(size), 0)[1], options.observations)
        cells = [
            f"{1e3 * np.median(seconds):.4f} ({1e3 * np.quantile(seconds, 0.95):.4f})"
            for seconds in measure(recording, options.observations)
        ]
        print(f"{size:>10}" + "".join(f"{cell:>21}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
