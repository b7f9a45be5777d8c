"""Reduce the points and the loop closures of long runs to those that are visible in a figure."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.scoring.loop_closures import closure_steps
from slamgauge.recording import Recording
from slamgauge.truth import Truth

MOST_POSES = 100_000  # points of a path; a run of a million steps of 0.1 m is drawn in steps of 1 m
MOST_VALUES = 1_000  # points of a curve; a panel of 3 in has 600 pixel columns at 200 dpi
MOST_CLOSURES = 60  # more marks would hide the paths, and the ticks would merge into a bar


def even_rows(count: int) -> Int:
    """Return the rows 0..`count`-1, or at most `MOST_POSES` evenly spaced ones with both ends."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST_POSES)).round().astype(np.int64))


def extreme_rows(values: Float, most: int = MOST_VALUES) -> Int:
    """Return all rows of a curve (n,), or about `most`: the minimum and the maximum of each section."""
    count = len(values)
    if count <= most:
        return np.arange(count)
    long = -(-count // (most // 2))
    stretches = np.append(values, np.full(-count % long, values[-1])).reshape(-1, long)
    gaps = np.isnan(stretches)  # a section of NaN only stays NaN
    ends = [np.where(gaps, np.inf, stretches).argmin(axis=1), np.where(gaps, -np.inf, stretches).argmax(axis=1)]
    rows = np.concatenate([np.arange(len(stretches)) * long + each for each in ends])
    return np.unique(np.append(rows.clip(max=count - 1), [0, count - 1]))


def marked_closures(truth: Truth | None, recording: Recording) -> tuple[Int, str]:
    """Return the steps of the loop closures to mark, and the label of a mark; no steps if associations are unknown."""
    steps = closure_steps(truth, recording)
    if steps is None:
        return recording.observation_step[:0], ""
    every = max(1, -(-len(steps) // MOST_CLOSURES))
    return steps[::every], "loop closure" if every == 1 else f"1 in {every} loop closures"
