"""Odometry and observations that have clocks of their own, brought onto the steps of one recording.

The rule: an observation belongs to the moment of its stamp. Where that falls between two rows of odometry, the step
between them is split there. The robot is taken to move at constant speed and yaw rate within the step, so that the
parts, composed, are the whole; their noise is the step's in proportion to their duration.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.compare.datasets.text_lines import Line
from slamgauge.se2 import exp, log, wrap

SAME = 1e-6  # s: stamps that are nearer than this are one; stamps of today in seconds resolve some 2e-7


class Odometry(NamedTuple):
    """Increments with their times.

    Attributes:
        stamps: (N+1,) [s], strictly increasing.
        increments: (N, 3) body-frame increments (dx, dy, dtheta) [m, m, rad], each turning by less than a circle.
        covs: (N, 3, 3) of the increments.
    """

    stamps: Float
    increments: Float
    covs: Float


def constant_twist(velocities: Float, seconds: Float) -> Float:
    """Return increments (n, 3) at constant velocities (n, 3) (forward, to the left, yaw rate) for seconds (n,)."""
    return exp(velocities * seconds[:, None])


def require_turns(lines: Sequence[Line], increments: Float) -> None:
    """Refuse the first line whose increment (n, 3) turns by more than half a circle, which no odometry resolves."""
    wild = np.abs(increments[:, 2]) > np.pi
    if wild.any():
        at = int(np.argmax(wild))
        remedy = "check the unit of angles, or write lines in between"
        raise lines[at].refused(f"the robot turns by {increments[at, 2]:.3g} rad within a row", remedy)


def joined(odometry: Odometry, times: Float) -> tuple[Odometry, Int, Marks, tuple[str, ...]]:
    """The odometry with a stamp wherever something was seen, at times (M,) [s].

    Returns:
        The odometry; the step of each observation within its span; which observations (M,) these are; and what to say
        of the others, which are left out.
    """
    inside = (times >= odometry.stamps[0] - SAME) & (times <= odometry.stamps[-1] + SAME)
    notes = () if inside.all() else (f"{np.sum(~inside)} observations outside the odometry's time are left out",)
    return *split_at(odometry, times[inside]), inside, notes


def split_at(odometry: Odometry, times: Float) -> tuple[Odometry, Int]:
    """The odometry with a stamp at each of the times (M,), all in its span, and the step (M,) that each has there."""
    stamps = odometry.stamps
    new = np.unique(times[np.abs(times - stamps[_nearest(stamps, times)]) > SAME])
    new = new[np.diff(new, prepend=-np.inf) > SAME]
    finer = np.sort(np.concatenate([stamps, new]))
    whole = np.searchsorted(stamps, finer[:-1], side="right") - 1
    fraction = np.diff(finer) / np.diff(stamps)[whole]
    increments = _part(odometry.increments[whole], fraction)
    return Odometry(finer, increments, fraction[:, None, None] * odometry.covs[whole]), _nearest(finer, times)


def interpolated(stamps: Float, poses: Float, times: Float, max_gap: float) -> Float:
    """Poses (M, 3) at times (M,) [s] between those of (n,) stamps, headings along the shorter arc.

    Rows of NaN stand where the times lie outside the stamps, or between two that are more than `max_gap` [s] apart.
    """
    before = np.clip(np.searchsorted(stamps, times + SAME, side="right") - 1, 0, len(stamps) - 1)
    after = np.minimum(before + 1, len(stamps) - 1)
    gap = stamps[after] - stamps[before]
    share = np.clip((times - stamps[before]) / np.where(gap > 0.0, gap, 1.0), 0.0, 1.0)
    met = np.abs(times - stamps[before]) <= SAME
    share[met] = 0.0
    found = poses[before] + share[:, None] * (poses[after] - poses[before])
    found[:, 2] = wrap(poses[before, 2] + share * wrap(poses[after, 2] - poses[before, 2]))
    known = met | ((times > stamps[0]) & (times < stamps[-1]) & (gap <= max_gap))
    found[~known] = np.nan
    return found


def _part(increments: Float, fraction: Float) -> Float:
    """Return the first `fraction` (n,) of increments (n, 3), driven at constant twist; whole ones are unchanged."""
    whole = fraction[:, None] == 1.0
    return np.where(whole, increments, exp(fraction[:, None] * log(increments)))


def _nearest(stamps: Float, times: Float) -> Int:
    """Index (M,) of the stamp that is nearest to each time."""
    after = np.clip(np.searchsorted(stamps, times), 1, len(stamps) - 1)
    return np.where(times - stamps[after - 1] <= stamps[after] - times, after - 1, after)
