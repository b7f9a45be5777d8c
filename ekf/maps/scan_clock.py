"""Recent observations, counted in scans and steps."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Int, Marks


class ScanClock:
    """Counts scans, and steps from the first scan on."""

    def __init__(self) -> None:
        self.scan = self._step = self._step_of_scan = 0

    @property
    def now(self) -> tuple[int, int]:
        """Present scan and step."""
        return self.scan, self._step

    def open_step(self) -> None:
        """Start a step."""
        self._step += self.scan > 0

    def close_scan(self) -> None:
        """End the scan of the present step."""
        self.scan += 1
        self._step_of_scan = self._step

    def are_recent(self, last: Int, scans: int) -> Marks:
        """Return whether scans and steps (n, 2) are in the last `scans` scans, at their mean duration.

        The limit on steps excludes old scans after a long time without observations.
        """
        ago_scans, ago_steps = (np.array(self.now) - last).T
        return (ago_scans <= scans) & (ago_steps * (self.scan - 1) <= scans * self._step_of_scan)
