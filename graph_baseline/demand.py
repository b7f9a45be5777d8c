"""What an optimum will take, told before it begins: memory, and the hours of the causal one."""

from __future__ import annotations

import numpy as np

from slamgauge.graph_baseline.factors import first_sights
from slamgauge.memory import require_memory
from slamgauge.notices import tell_once
from slamgauge.recording import Recording

LONG = 600.0  # s
RATE = 5e8  # multiply-adds of factors of the landmarks' information in a second, all else that a step takes included
MAPS, MATRICES = 10.0, 6.0  # arrays alive at once: of all poses' maps, of the landmarks' information


def require_room(recording: Recording, name: str) -> None:
    """Refuse a recording whose poses' maps (K, 3, 2L+1), K with scans, and information (2L, 2L) do not fit.

    Both optima need them: the causal one is held against the other in the end.
    """
    landmarks, scans = _counts(recording)
    needed = 8.0 * (MAPS * 3 * scans * 2 * landmarks + MATRICES * (2 * landmarks) ** 2)
    what = f"{name} of {landmarks} landmarks in {scans} scans"
    require_memory(needed, what, "leave it out or give a part of them")


def tell_if_long(recording: Recording) -> None:
    """Say it where the causal optimum takes hours."""
    landmarks, scans = _counts(recording)
    first = recording.observation_step[first_sights(recording)[1]]
    mapped = np.searchsorted(np.sort(first), np.unique(recording.observation_step), side="right")
    seconds = float(np.sum((2.0 * mapped) ** 3)) / 6.0 / RATE
    if seconds > LONG:
        tell_once(
            f"isam2 of {landmarks} landmarks in {scans} scans takes some {seconds / 3600.0:.1f} h; "
            "--estimators without it, or with batch, takes less"
        )


def _counts(recording: Recording) -> tuple[int, int]:
    """Landmarks, and poses that see any."""
    return len(first_sights(recording)[0]), len(np.unique(recording.observation_step))
