"""Doubts about a path read from a file: its motions are compared with the odometry."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from slamgauge.arrays import Float
from slamgauge.recording import Recording
from slamgauge.se2 import between

MOST = 2.0  # largest ratio, or inverse ratio, of motions that are the same but for errors
START = np.array([1.0, 1.0, 0.5])  # m, m, rad: a start that is farther from the prior's mean than this and 6 sigmas
SHIFTS, CLEARLY, TURNING = 6, 4.0, 0.02  # delays that are tried; ratio of mean squares; rad that make a delay visible
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
    agrees = True
    for what, columns, remedy in (
        ("distances", [0, 1], "check the unit of lengths, the directions of the axes and the stamps"),
        ("turns", [2], "check the unit and the sign of headings, and the stamps"),
    ):
        odometry = recording.odometry[known][:, columns]
        squares = float(np.sum(odometry**2))
        ratio = float(np.sum(odometry * motions[known][:, columns])) / (squares or 1.0)
        if squares > SIGNAL * float(np.sum(variances[known][:, columns])) and not 1.0 / MOST <= ratio <= MOST:
            yield f"has {ratio:.3g} times the {what} of the odometry; {remedy}"
            agrees = False
    late = _delay(poses, recording) if agrees and known.any() else 0.0
    if late:
        yield f"turns {abs(late):.3g} s {'after' if late > 0.0 else 'before'} the odometry; check its stamps"


def _delay(poses: Float, recording: Recording) -> float:
    """Return the time [s] by which the turns along a path are later than those of the odometry; 0 if that is not clear.

    Turns in a second are compared at delays of up to `SHIFTS` half seconds; steps that take longer have longer delays.
    """
    known, stamps = np.isfinite(poses).all(axis=1), recording.stamps
    window = max(1.0, 2.0 * float(np.median(np.diff(stamps))))
    shifts = 0.5 * window * np.arange(-SHIFTS, SHIFTS + 1)
    times = np.arange(stamps[0] - shifts[0], stamps[-1] - shifts[-1] - window, 0.5 * window)
    if len(times) < 4 * SHIFTS:
        return 0.0
    driven, path = np.append(0.0, np.cumsum(recording.odometry[:, 2])), np.unwrap(poses[known, 2])
    turns = np.interp(times + window, stamps, driven) - np.interp(times, stamps, driven)
    found = list[float]()
    for shift in shifts:
        begin, end = np.interp([times + shift, times + shift + window], stamps[known], path)
        found.append(float(np.mean((end - begin - turns) ** 2)))
    best = int(np.argmin(found))
    is_clear = found[SHIFTS] > CLEARLY * found[best] and found[SHIFTS] > TURNING**2
    return float(shifts[best]) if is_clear else 0.0
