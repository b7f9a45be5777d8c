"""Choose the loop closures that a figure marks."""

from __future__ import annotations

from slamgauge.arrays import Int
from slamgauge.compare.scoring.loop_closures import closure_steps
from slamgauge.recording import Recording
from slamgauge.truth import Truth

MOST = 60  # more marks would hide the paths, and the ticks would merge into a bar


def marked_closures(truth: Truth | None, recording: Recording) -> tuple[Int, str]:
    """Return the steps of the loop closures to mark, and the label of a mark; no steps if associations are unknown."""
    steps = closure_steps(truth, recording)
    if steps is None:
        return recording.observation_step[:0], ""
    every = max(1, -(-len(steps) // MOST))
    return steps[::every], "loop closure" if every == 1 else f"1 in {every} loop closures"
