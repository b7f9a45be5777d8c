"""Steps that a running estimator has finished, for displays of progress in other threads."""

from __future__ import annotations

from collections.abc import Iterator

_step: tuple[int, int] | None = None  # newest step and last step, while an estimator counts them


def counted_steps(last: int) -> Iterator[int]:
    """Yield the steps 0..last, and store the newest for `step_text` until the end or an error."""
    global _step  # one estimator runs at a time in a process
    try:
        for k in range(last + 1):
            _step = k, last
            yield k
    finally:
        _step = None


def step_text() -> str:
    """Return `, step 3000 of 8872`, or an empty text while no estimator counts its steps."""
    step = _step
    return f", step {step[0]} of {step[1]}" if step else ""
