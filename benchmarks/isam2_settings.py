"""iSAM2's relinearisation settings, accuracy against time: one table.

    python benchmarks/isam2_settings.py [--landmarks 20,100] [--steps N]

Accuracy is the distance of the newest position from the batch optimum of the measurements up to then,
in standard deviations, at ten steps spread over the run. The setting in use is marked. With --steps a run ends
after so many steps.
"""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads

pin_blas_threads()

import argparse
from dataclasses import replace

import numpy as np

from slamgauge import simulate
from slamgauge.compare.bench.bench import workload
from slamgauge.graph_baseline import batch
from slamgauge.graph_baseline.causal import SETTINGS, causal_optimum


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--landmarks", default="20,100")
    parser.add_argument("--steps", type=int, default=None)
    options = parser.parse_args()
    print(
        f"{'landmarks':>9} {'threshold':>9} {'every':>6} {'ms a step':>10} {'p95':>8} {'off [sigma]':>12} {'worst':>8}"
    )
    for size in map(int, options.landmarks.split(",")):
        _, recording = simulate(workload(size), 0)
        recording = recording.first(min(options.steps or recording.steps, recording.steps))
        steps = np.linspace(recording.steps / 10, recording.steps, 10).astype(int)
        optima = [batch(recording.first(int(k))) for k in steps]
        for threshold, every in ((0.1, 1), (0.1, 10), (0.05, 1), (0.05, 10), (0.02, 1), (0.02, 10), (0.01, 10)):
            settings = replace(SETTINGS, relinearize_threshold=threshold, relinearize_every=every)
            estimate = causal_optimum(recording, settings)
            off: list[float] = []
            for k, optimum in zip(steps, optima, strict=True):
                assert optimum.pose_covs is not None
                sigma = np.sqrt(np.trace(optimum.pose_covs[-1][:2, :2]))
                off.append(float(np.hypot(*(estimate.poses[k] - optimum.poses[-1])[:2]) / sigma))
            assert estimate.seconds is not None
            second = estimate.seconds[recording.steps // 2 :] * 1e3
            print(
                f"{size:9} {threshold:9} {every:6} {np.median(second):10.2f} {np.quantile(second, 0.95):8.2f} "
                f"{np.sqrt(np.mean(np.square(off))):12.4f} {max(off):8.4f}{' <' if settings == SETTINGS else ''}",
                flush=True,
            )


if __name__ == "__main__":
    main()
