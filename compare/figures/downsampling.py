"""Which points of a very long run a picture needs: more than these nobody can tell apart, and each takes memory."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, Int

MOST_POSES = 100_000  # of a path: steps of a decimetre become steps of a metre in a run of a million
MOST_VALUES = 1_000  # of a curve: a panel of 3 in has 600 columns of dots at 200 dpi


def even_rows(count: int) -> Int:
    """All of 0..`count`-1, or as many as a path needs, evenly spread, both ends among them."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST_POSES)).round().astype(np.int64))


def extreme_rows(values: Float, most: int = MOST_VALUES) -> Int:
    """All rows of a curve (n,), or some `most` that show its peaks: the smallest and the largest of every stretch."""
    count = len(values)
    if count <= most:
        return np.arange(count)
    long = -(-count // (most // 2))
    stretches = np.append(values, np.full(-count % long, values[-1])).reshape(-1, long)
    gaps = np.isnan(stretches)  # a stretch of gaps alone is a gap
    ends = [np.where(gaps, np.inf, stretches).argmin(axis=1), np.where(gaps, -np.inf, stretches).argmax(axis=1)]
    rows = np.concatenate([np.arange(len(stretches)) * long + each for each in ends])
    return np.unique(np.append(rows.clip(max=count - 1), [0, count - 1]))
