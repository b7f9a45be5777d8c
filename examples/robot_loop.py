"""The filter in a robot's loop, here with a recording as input: `python examples/robot_loop.py tuned/recording.npz`.

A robot calls `predict` with the increment of a step and its covariance, then `update` with the observations of the step
if there are any. The gate rejects observations that are too unlikely.
"""

from __future__ import annotations

import sys
from time import perf_counter

import numpy as np

from slamgauge import SlamFilter, load_recording

GATE = 13.8  # squared Mahalanobis distance of range and bearing; true observations exceed it with probability 0.001


def main(path: str) -> None:
    """Print the final pose with its sigmas, the number of rejected observations, and the times of the steps."""
    recording = load_recording(path)
    slam = SlamFilter(recording.sensor, recording.prior_mean, recording.prior_cov, "right-invariant")
    seconds, rejected = np.empty(recording.steps + 1), 0
    for step, observations in enumerate(recording.scans()):
        start = perf_counter()
        if step > 0:
            slam.predict(recording.odometry[step - 1], recording.odometry_cov[step - 1])
        if len(observations.value):
            slam.update(observations, gate=GATE)
            rejected += int((slam.associated < 0).sum())
        seconds[step] = perf_counter() - start
    x, y, heading = slam.pose
    sigma = np.sqrt(np.diag(slam.pose_cov))
    print(f"pose    {x:.3f} m, {y:.3f} m, {heading:.4f} rad")
    print(f"sigma   {sigma[0]:.3f} m, {sigma[1]:.3f} m, {sigma[2]:.4f} rad")
    print(
        f"map     {len(slam.landmark_ids)} landmarks; {rejected} of {len(recording.observation)} observations rejected"
    )
    median, most = np.quantile(seconds, [0.5, 0.95]) * 1e6
    print(f"a step  median {median:.0f} us, 95 % within {most:.0f} us; the first ones load compiled code")


if __name__ == "__main__":
    main(sys.argv[1])
