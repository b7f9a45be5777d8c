"""Which loop closures a figure marks."""

from __future__ import annotations

from slamgauge.arrays import Int
from slamgauge.compare.scoring.loop_closures import closure_steps
from slamgauge.recording import Recording
from slamgauge.truth import Truth

MOST = 60  # more marks than these would hide the paths, and make a bar of the ticks


def marked_closures(truth: Truth | None, recording: Recording) -> tuple[Int, str]:
    """Steps of the closures to mark, and what one mark stands for; no steps where nobody knows of any."""
    steps = closure_steps(truth, recording)
    if steps is None:
        return recording.observation_step[:0], ""
    every = max(1, -(-len(steps) // MOST))
    return steps[::every], "loop closure" if every == 1 else f"1 in {every} loop closures"
