"""Odometry and observations with different clocks, brought onto the steps of one recording.

An observation belongs to the moment of its stamp. If that is between two rows of odometry, the step between them is
split there. The robot is assumed to move at constant speed and yaw rate within the step: the parts, composed, are the
whole step, and each has a share of its noise in proportion to its duration.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.compare.storage.text_lines import Line
from slamgauge.compare.storage.trajectories import SAME
from slamgauge.errors import UserError
from slamgauge.se2 import exp, log

GAP, MANY_ROWS = 1.0, 10.0  # s, typical times between rows: the shortest gap that a note is printed about
FEW, SHORTEST = 20, 0.01  # observations; share of the odometry's time that they should cover


class Odometry(NamedTuple):
    """Stamps (N+1,) [s], strictly increasing, body-frame increments (N, 3) [m, m, rad] and covariances (N, 3, 3).

    `lines` (N,) are the lines of a text that the increments are from, for messages.
    """

    stamps: Float
    increments: Float
    covs: Float
    lines: Sequence[Line] = ()


def joined(odometry: Odometry, times: Float) -> tuple[Odometry, Int, Marks, list[str]]:
    """Split odometry at the times (M,) [s] of observations.

    Return the odometry; the step of each observation within its span; which observations (M,) these are; and notes
    about the others, which are dropped, and about a gap of the odometry. It is a UserError if all observations, or more
    than half of many, are outside the span, or if their own span is too short.
    """
    first, last = odometry.stamps[0], odometry.stamps[-1]
    inside = (times >= first - SAME) & (times <= last + SAME)
    outside, many = int(np.sum(~inside)), len(times) > FEW
    too_short = many and np.ptp(times) < SHORTEST * (last - first)
    if too_short or outside > len(times) * (0.5 if many else 0.99):
        begin, end, first, last = map(shown_stamp, (times.min(), times.max(), first, last))
        spans = f"observations from {begin} to {end} s, odometry from {first} to {last} s"
        raise UserError(f"{spans}; give each file the unit of its stamps, and both the same clock")
    share = f", {outside / len(times):.0%}: check units and clocks of the files" if outside > 0.1 * len(times) else ""
    notes = [f"{outside} observations outside the odometry's time are dropped{share}"] if outside else []
    seconds = np.diff(odometry.stamps)
    longest = int(np.argmax(seconds))
    if seconds[longest] >= max(GAP, MANY_ROWS * float(np.median(seconds))):
        where = f"{seconds[longest]:.3g} s from {shown_stamp(odometry.stamps[longest])} s on"
        notes.append(f"the odometry has no row for {where}: constant speeds are assumed there")
    return *split_at(odometry, times[inside]), inside, notes


def shown_stamp(seconds: float) -> str:
    """Return a stamp [s] with all its digits, at most nine behind the point."""
    return np.format_float_positional(seconds, precision=9, trim="-")


def split_at(odometry: Odometry, times: Float) -> tuple[Odometry, Int]:
    """Split odometry at times (M,) within its span; return it and the step (M,) of each time."""
    stamps = odometry.stamps
    new = np.unique(times[np.abs(times - stamps[_nearest(stamps, times)]) > SAME])
    new = new[np.diff(new, prepend=-np.inf) > SAME]
    finer = np.sort(np.concatenate([stamps, new]))
    whole = np.searchsorted(stamps, finer[:-1], side="right") - 1
    share = (np.diff(finer) / np.diff(stamps)[whole])[:, None]
    increments, covs = odometry.increments[whole], odometry.covs[whole]
    parts = np.where(share == 1.0, increments, exp(share * log(increments)))  # whole steps are unchanged
    return Odometry(finer, parts, share[:, None] * covs), _nearest(finer, times)


def _nearest(stamps: Float, times: Float) -> Int:
    """Return the index (M,) of the stamp nearest to each time."""
    after = np.clip(np.searchsorted(stamps, times), 1, len(stamps) - 1)
    return np.where(times - stamps[after - 1] <= stamps[after] - times, after - 1, after)
