"""Detects a diverged filter by its innovations, and prints that once, at the step where it shows."""

from __future__ import annotations

from slamgauge.ekf.maps.correction_table import Rule, estimator_of
from slamgauge.notices import tell_once

LOST = 1e4  # NIS over its degrees of freedom: linearisation does not hold where noise is that small


class DivergenceMonitor:
    """Sum of the NIS of a filter's steps.

    Args:
        rule: of the filter.
    """

    def __init__(self, rule: Rule) -> None:
        self._name = estimator_of(rule)
        self._nis, self._dof = 0.0, 0

    def checked(self, result: tuple[float, int]) -> tuple[float, int]:
        """Add the NIS of a step and its degrees of freedom, and return them."""
        nis, dof = result
        self._nis, self._dof = self._nis + nis, self._dof + dof
        if self._nis > LOST * max(1, self._dof):
            tell_once(
                f"{self._name} has lost itself: its NIS is {LOST:g} times what noise explains; raise the sensor's noise"
            )
        return result
