"""Ids that are given once."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Int


class Ids:
    """Allots 0, 1, 2, ...; none is ever given again."""

    def __init__(self) -> None:
        self.given = 0

    def take(self, count: int) -> Int:
        """The next `count` ids."""
        first = self.given
        self.given += count
        return np.arange(first, self.given)
