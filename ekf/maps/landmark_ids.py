"""Ids of landmarks: new ones, merged ones, and those of a scan."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Int, Marks

GONE = -1


class Ids:
    """Source of the ids 0, 1, 2, ...; each is used once."""

    def __init__(self) -> None:
        self.given = 0

    def take(self, count: int) -> Int:
        """Return the next `count` ids."""
        first = self.given
        self.given += count
        return np.arange(first, self.given)


def followed(fate: Int) -> Int:
    """Return the final successor of each id from the next one, `fate`; the last entry is that of GONE."""
    while ((further := fate[fate]) != fate).any():
        fate = further
    return fate


def of_scan(ids: Int, known: Int) -> tuple[Marks, Marks, Marks]:
    """Return which observations (m,) of a scan are of known landmarks, first of new ones, and further of new ones."""
    mapped = np.isin(ids, known)
    first = np.zeros(len(ids), dtype=np.bool_)
    first[np.unique(ids, return_index=True)[1]] = True
    return mapped, first & ~mapped, ~first & ~mapped
