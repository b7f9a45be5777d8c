"""Notice that a filter has diverged, printed once, at the step whose innovations show it."""

from __future__ import annotations

from slamgauge.ekf.maps.correction_table import Rule
from slamgauge.notices import tell_once

LOST = 1e4  # NIS divided by its degrees of freedom; noise that is too small for the linearisation gives such values


class DivergenceMonitor:
    """Sum of the NIS of a filter's steps.

    Args:
        rule: of the filter, with its name.
    """

    def __init__(self, rule: Rule) -> None:
        self._name = rule.estimator
        self._nis, self._dof = 0.0, 0

    def checked(self, result: tuple[float, int]) -> tuple[float, int]:
        """Add the NIS of a step and its degrees of freedom, and return them."""
        nis, dof = result
        self._nis, self._dof = self._nis + nis, self._dof + dof
        if self._nis > LOST * max(1, self._dof):
            tell_once(
                f"{self._name} has diverged: its NIS is over {LOST:g} times its degrees of freedom; raise sensor noise"
            )
        return result
