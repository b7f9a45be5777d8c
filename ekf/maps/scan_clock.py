"""What is lately seen, by scans and by the steps that they take."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Int, Marks


class ScanClock:
    """Counts scans, and steps from the first scan on."""

    def __init__(self) -> None:
        self.scan = self._step = self._step_of_scan = 0

    @property
    def now(self) -> tuple[int, int]:
        """The present scan and step."""
        return self.scan, self._step

    def open_step(self) -> None:
        """The robot moves on."""
        self._step += self.scan > 0

    def close_scan(self) -> None:
        """All that the present step has seen is noted."""
        self.scan += 1
        self._step_of_scan = self._step

    def are_recent(self, last: Int, scans: int) -> Marks:
        """Whether scans and steps (n, 2) are among the last scans, and lie no further back than so many take.

        How long they take is the mean over all scans so far: where the robot has seen nothing for long, the last scans
        are none to go by.
        """
        ago_scans, ago_steps = (np.array(self.now) - last).T
        return (ago_scans <= scans) & (ago_steps * (self.scan - 1) <= scans * self._step_of_scan)
