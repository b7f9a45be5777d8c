"""Steps that shrink slowly, or grow, mixed so that they shrink fast: Anderson's acceleration of a fixed-point map.

Gauss-Newton steps leave out second derivatives times residuals: where the recording does not fit the model they shrink
by a constant factor, or swing ever wider. So do steps whose matrices were taken elsewhere (`chord`). The mix of the
last moves that would cancel the step, were the map linear, stands in for what is left out. Source: Anderson (J. ACM
12(4), 1965); Walker & Ni (SIAM J. Numer. Anal. 49(4), 2011).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from slamgauge.arrays import Float

MEMORY = 10  # moves
FAST = 0.3  # of a step is left for the next: then nothing is mixed
RESOLVED = 1e-10  # singular values below this share of the largest are rounding


class AndersonAcceleration:
    """The moves of an iteration so far."""

    def __init__(self) -> None:
        self._moves: list[Float] = []
        self._steps: list[Float] = []
        self._scaled: list[Float] = []

    def move(self, step: Float, scaled: Float) -> Float:
        """What to move by (n,) where the iteration would go on by `step` (n,).

        Args:
            step: in the iteration's own coordinates.
            scaled: (m,) linear in it, in standard deviations: what is to become small.
        """
        self._steps.append(step)
        self._scaled.append(scaled)
        if not self._moves or largest_entry(scaled) < FAST * largest_entry(self._scaled[-2]):
            return step
        try:
            Q, R = np.linalg.qr(_changes(self._scaled))
            share = np.linalg.lstsq(R, Q.T @ scaled, rcond=RESOLVED)[0]
        except np.linalg.LinAlgError:  # they are not finite
            return step
        return step - (np.column_stack(self._moves) + _changes(self._steps)) @ share

    def moved(self, move: Float) -> None:
        """Keep how far (n,) it was that the iteration moved."""
        self._moves.append(move)
        del self._moves[:-MEMORY], self._steps[:-MEMORY], self._scaled[:-MEMORY]


def largest_entry(scaled: Float) -> float:
    """Largest entry of a step (m,) in standard deviations."""
    return float(np.max(np.abs(scaled), initial=0.0))


def _changes(steps: list[Float]) -> Float:
    """(n, s-1) from one of s steps to the next."""
    return np.column_stack([after - before for before, after in pairwise(steps)])
