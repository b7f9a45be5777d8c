"""Doubts about a path read from a file: its motions are compared with the odometry."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from slamgauge.arrays import Float
from slamgauge.recording import Recording
from slamgauge.se2 import between

MOST = 2.0  # largest ratio, or inverse ratio, of motions that are the same but for errors
START = np.array([1.0, 1.0, 0.5])  # m, m, rad: a start that is farther from the prior's mean than this and 6 sigmas
SIGNAL = 4.0  # smallest ratio of the odometry's squares to its variances; below it the odometry is mostly noise


def path_doubts(poses: Float, recording: Recording) -> Iterator[str]:
    """Yield what the motions along a path contradict, as ends of sentences that begin with the name of the path.

    The ratio is the least-squares slope of the motions in the body frame over the odometry: 1 apart from errors, 0.001
    for metres read as millimetres, 57 for degrees, -1 for clockwise angles.

    Args:
        poses: (N+1, 3) x, y [m], heading [rad]; rows of NaN are not used.
        recording: its odometry is the reference.
    """
    start = np.abs(between(recording.prior_mean, poses[0]))
    if (start > START + 6.0 * np.sqrt(np.diag(recording.prior_cov).max())).any():
        x, y, heading = poses[0]
        yield f"starts at ({x:.4g} m, {y:.4g} m, {heading:.3g} rad), far from the prior; check its frame and headings"
    motions = between(poses[:-1], poses[1:])
    known = np.isfinite(motions).all(axis=1)
    variances = np.diagonal(recording.odometry_cov, axis1=1, axis2=2)
    for what, columns, remedy in (
        ("distances", [0, 1], "check the unit of lengths, the directions of the axes and the stamps"),
        ("turns", [2], "check the unit and the sign of headings, and the stamps"),
    ):
        odometry = recording.odometry[known][:, columns]
        squares = float(np.sum(odometry**2))
        if squares <= SIGNAL * float(np.sum(variances[known][:, columns])):
            continue
        ratio = float(np.sum(odometry * motions[known][:, columns])) / squares
        if not 1.0 / MOST <= ratio <= MOST:
            yield f"has {ratio:.3g} times the {what} of the odometry; {remedy}"
