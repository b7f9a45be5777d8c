"""Anderson acceleration of a fixed-point iteration.

Gauss-Newton neglects the second derivatives of residuals. With large residuals its steps converge slowly or diverge.
The same happens to chord steps, whose matrices were computed at another point (`chord_descent`). Anderson acceleration
combines the last moves so that the next step would be smallest if the iteration were linear.

Sources: Anderson (J. ACM 12(4), 1965); Walker & Ni (SIAM J. Numer. Anal. 49(4), 2011).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from slamgauge.arrays import Float

MEMORY = 10  # stored moves
FAST = 0.3  # a step below this share of the previous step is not accelerated
RESOLVED_SHARE = 1e-10  # singular values below this share of the largest are rounding


class AndersonAcceleration:
    """The last moves and steps of an iteration."""

    def __init__(self) -> None:
        self._moves: list[Float] = []
        self._steps: list[Float] = []
        self._scaled: list[Float] = []

    def accelerate(self, step: Float, scaled: Float) -> Float:
        """Return the accelerated move (n,) for a proposed `step` (n,).

        Args:
            step: step of the iteration, in its coordinates.
            scaled: (m,) a linear function of the step in standard deviations, whose norm is minimised.
        """
        self._steps.append(step)
        self._scaled.append(scaled)
        if not self._moves or largest_entry(scaled) < FAST * largest_entry(self._scaled[-2]):
            return step
        try:
            Q, R = np.linalg.qr(_changes(self._scaled))
            share = np.linalg.lstsq(R, Q.T @ scaled, rcond=RESOLVED_SHARE)[0]
        except np.linalg.LinAlgError:  # entries are not finite
            return step
        return step - (np.column_stack(self._moves) + _changes(self._steps)) @ share

    def record(self, move: Float) -> None:
        """Store the move (n,) that the iteration made."""
        self._moves.append(move)
        del self._moves[:-MEMORY], self._steps[:-MEMORY], self._scaled[:-MEMORY]


def largest_entry(scaled: Float) -> float:
    """Return the largest absolute entry of a step (m,) in standard deviations."""
    return float(np.max(np.abs(scaled), initial=0.0))


def _changes(steps: list[Float]) -> Float:
    """Return the differences (n, s-1) of s consecutive steps."""
    return np.column_stack([after - before for before, after in pairwise(steps)])
