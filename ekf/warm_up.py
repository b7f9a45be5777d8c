"""Compilation ahead of the first step, announced when it takes long."""

from __future__ import annotations

import functools
import sys
import threading

import numpy as np

from ekf import compatibility, corrections, kernels, map_edits
from ekf.workspace import allocate

ANNOUNCE_AFTER = 1.0  # s; loading kernels from the cache is faster than this


@functools.cache
def compile_once() -> None:
    """Compile (or load from the cache) every kernel of the online filter, once per process.

    Says so on standard error when it takes longer than a second: the first use after installation.
    """
    announcement = threading.Timer(
        ANNOUNCE_AFTER,
        print,
        args=["slamgauge: compiling the filter kernels (once per installation, kept on disk) ..."],
        kwargs={"file": sys.stderr},
    )
    announcement.start()
    try:
        _run_every_kernel()
    finally:
        announcement.cancel()


def _run_every_kernel() -> None:
    sensor = 0
    state, cov, work = np.zeros(7), np.eye(7), allocate(1, 7, 1)  # room for two landmarks
    work.observation[:] = 1.0, 0.0
    work.observation_cov[:] = np.eye(2)
    kernels.predict(state, state, cov, 3, np.zeros(3), np.zeros((3, 3)))
    kernels.augment(sensor, state, state, cov, 3, 1, work)
    kernels.find_slots(work.ids, work.slots, work.ids, work.slots)
    for update in (corrections.update_standard, corrections.update_iterated, corrections.update_right_invariant):
        update(sensor, state, state, cov, 5, 1, work)
    pairs, quantiles = compatibility.allocate_pairs(1), np.array([0.0, 9.0])
    covs, marks = np.eye(2)[None], np.zeros((1, 1), dtype=np.bool_)
    count = compatibility.find_compatible(sensor, state, state, cov, 5, state[None, 3:5], covs, 9.0, pairs)
    compatibility.search_jointly(cov, covs, pairs, count, 9.0, quantiles, 1, work.slots)
    compatibility.mark_ambiguous(cov, covs, pairs, count, 9.0, 0.0, work.slots, marks[0])
    map_edits.find_duplicate(state, cov, 5, work.slots, marks, 9.0, 1.0)
    map_edits.equate_landmarks(state, cov, 7, 0, 1, work)
    map_edits.remove_landmark(state, state, cov, 5, 0)
    corrections.retract_standard(state, cov, 5, work)
    corrections.retract_right_invariant(state, cov, 5, work)
