"""Loop closures: steps at which a landmark is re-observed after a long absence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamgauge.arrays import Int, chunks, distinct
from slamgauge.compare.scoring.measured import Measured
from slamgauge.compare.scoring.nan_stats import number
from slamgauge.recording import Recording
from slamgauge.truth import NOBODY, Truth

ABSENCE = 10.0  # least time [s] without an observation of the landmark
ROUNDING = 1e-6  # rounding error [s] of stamps such as 0.1 k


@dataclass(frozen=True)
class LoopClosure:
    """Position error and uncertainty at a loop closure; None if unknown.

    `error_before_m` and `sigma_before_m` are those of the pose before `step`, the others those of the pose at `step`.
    A sigma is the root of the trace of the position covariance.
    """

    step: int
    error_before_m: float | None
    error_after_m: float | None
    sigma_before_m: float | None
    sigma_after_m: float | None


def closure_steps(truth: Truth | None, recording: Recording) -> Int | None:
    """Return the increasing steps of the loop closures, by the recording's ids or the truth's; None without ids."""
    ids = recording.landmark
    if ids is None:
        ids = None if truth is None else truth.association
    if ids is None:
        return None
    names, found = distinct(ids), [np.zeros(0, dtype=np.int64)]
    last = np.full(len(names), np.inf)  # time of the last observation of each landmark
    for rows in chunks(len(ids)):
        of_landmarks = np.flatnonzero(ids[rows] != NOBODY)
        slot, step = np.searchsorted(names, ids[rows][of_landmarks]), recording.observation_step[rows][of_landmarks]
        order = np.argsort(slot, kind="stable")  # sorted by landmark, then by time
        slot, step, stamp = slot[order], step[order], recording.stamps[step[order]]
        begins = np.diff(slot, prepend=-1) != 0
        before = np.where(begins, last[slot], np.roll(stamp, 1))
        found.append(step[stamp - before >= ABSENCE - ROUNDING])
        ends = np.diff(slot, append=-1) != 0
        last[slot[ends]] = stamp[ends]
    return np.unique(np.concatenate(found))


def loop_closures(found: Measured) -> tuple[LoopClosure, ...] | None:
    """Return errors and sigmas of an estimate at its loop closures; None without ids."""
    steps = closure_steps(found.truth, found.recording)
    if steps is None:
        return None
    sigmas = np.sqrt((found.covs[:, 0, 0] + found.covs[:, 1, 1]).clip(min=0))
    before_and_after = np.column_stack([found.off[steps - 1], found.off[steps], sigmas[steps - 1], sigmas[steps]])
    return tuple(
        LoopClosure(step, *map(number, figures))
        for step, figures in zip(steps.tolist(), before_and_after.tolist(), strict=True)
    )
