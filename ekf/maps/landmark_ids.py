"""Ids that are given once, and what becomes of them."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Int, Marks

GONE = -1


class Ids:
    """Allots 0, 1, 2, ...; none is ever given again."""

    def __init__(self) -> None:
        self.given = 0

    def take(self, count: int) -> Int:
        """The next `count` ids."""
        first = self.given
        self.given += count
        return np.arange(first, self.given)


def followed(fate: Int) -> Int:
    """What becomes of each id in the end, if `fate` is what becomes of it next; of GONE, the last, GONE."""
    while ((further := fate[fate]) != fate).any():
        fate = further
    return fate


def of_scan(ids: Int, known: Int) -> tuple[Marks, Marks, Marks]:
    """Which observations of a scan (m,) are of known landmarks, map a new one, or see a new one again."""
    mapped = np.isin(ids, known)
    first = np.zeros(len(ids), dtype=np.bool_)
    first[np.unique(ids, return_index=True)[1]] = True
    return mapped, first & ~mapped, ~first & ~mapped
