"""Checks of the rows of odometry and observations that all readers of text files share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.storage.text_lines import Line

UNWRAPPED = 0.5  # rad: largest turn in a row whose difference of headings jumps by a whole turn


def require_order(lines: Sequence[Line], stamps: Float, *, strict: bool) -> None:
    """Refuse the first line whose stamp [s] is before that of the line above, or equal to it if `strict`."""
    steps = np.diff(stamps)
    wrong = steps <= 0.0 if strict else steps < 0.0
    if wrong.any():
        at = int(np.argmax(wrong)) + 1
        last, here = stamps[at - 1], stamps[at]
        if here == last:
            raise lines[at].refused(f"stamp {here:.9f} is that of the line above", "keep one line for each stamp")
        raise lines[at].refused(f"stamp {here:.9f} comes after {last:.9f}", "sort the lines by time")


def require_turns(lines: Sequence[Line], increments: Float) -> None:
    """Refuse the first line whose increment (n, 3) turns by more than half a circle: odometry cannot resolve that."""
    wild = np.abs(increments[:, 2]) > np.pi
    if wild.any():
        at = int(np.argmax(wild))
        remedy = "check the units of angles and stamps, or write lines in between"
        if (np.abs(np.abs(increments[wild, 2]) - 2.0 * np.pi) < UNWRAPPED).all():
            remedy = "these look like differences of headings from -pi to pi: wrap the differences into (-pi, pi]"
        raise lines[at].refused(f"the robot turns by {increments[at, 2]:.3g} rad in one row", remedy)


def require_ranges(lines: Sequence[Line], ranges: Float) -> None:
    """Refuse the first line whose range [m] is negative."""
    negative = ranges < 0.0
    if negative.any():
        raise lines[int(np.argmax(negative))].refused("the range is negative", "remove the line")


def require_bearings(lines: Sequence[Line], bearings: Float) -> None:
    """Refuse the first line whose bearing [rad] is larger than a full turn: it may be in degrees."""
    wrong = np.abs(bearings) > 2.0 * np.pi
    if wrong.any():
        at = int(np.argmax(wrong))
        remedy = "correct the unit (in csv: bearing [deg] in the header, or observations.angle), or wrap it"
        raise lines[at].refused(f"the bearing {bearings[at]:.6g} rad is more than a full turn", remedy)
