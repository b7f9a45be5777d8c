"""Steps that shrink slowly, or grow, mixed so that they shrink fast: Anderson's acceleration of a fixed-point map.

Gauss-Newton steps leave out second derivatives times residuals: where the recording does not fit the model they shrink
by a constant factor, or swing ever wider. The mix of the last moves that would cancel the step, were the map linear,
stands in for what is left out. Source: Anderson (J. ACM 12(4), 1965); Walker & Ni (SIAM J. Numer. Anal. 49(4), 2011).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from slamgauge.arrays import Float

MEMORY = 10  # moves
FAST = 0.3  # of a step is left for the next: then nothing is mixed
RESOLVED = 1e-10  # singular values below this share of the largest are rounding


class Mixing:
    """The moves of an iteration so far.

    Args:
        weight: (n,) of each coordinate, one over its standard deviation.
    """

    def __init__(self, weight: Float) -> None:
        self._weight = weight
        self._moves: list[Float] = []
        self._steps: list[Float] = []

    def move(self, step: Float) -> Float:
        """What to move by (n,) where the iteration would go on by `step` (n,)."""
        self._steps.append(step)
        changes = [after - before for before, after in pairwise(self._steps)]
        if not changes or self.size(step) < FAST * self.size(self._steps[-2]):
            return step
        C = np.column_stack(changes)
        share = np.linalg.lstsq(self._weight[:, None] * C, self._weight * step, rcond=RESOLVED)[0]
        return step - (np.column_stack(self._moves) + C) @ share

    def moved(self, move: Float) -> None:
        """Keep how far (n,) it was that the iteration moved."""
        self._moves.append(move)
        del self._moves[:-MEMORY], self._steps[:-MEMORY]

    def size(self, step: Float) -> float:
        """Of a step (n,), the largest coordinate in standard deviations."""
        return float(np.max(np.abs(step) * self._weight, initial=0.0))
