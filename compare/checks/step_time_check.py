"""Check of the growth of the step time with the size of the map."""

from __future__ import annotations

import numpy as np

from slamgauge.compare.checks.check import Subject, check
from slamgauge.compare.checks.small_recordings import SIGMA, World

SMALLEST, LARGEST = 20, 320  # landmarks
STEPS = 6
BOUND = 2.75
LONG = 0.2  # s; the map is not doubled after a longer run, because the next may take 16 times as long
SHORTEST = 1e-3  # s; the time of faster steps depends on clocks and caches, and counts as this


def _run_seconds(subject: Subject, landmarks: int, steps: int) -> float:
    """Return the smaller processor time of two runs [s]; the first scan observes all landmarks, later ones one each."""
    side = int(np.ceil(np.sqrt(landmarks)))
    row, column = np.divmod(np.arange(landmarks), side)
    later = ((step, step % landmarks) for step in range(1, steps + 1))
    world = World(
        moves=np.tile([0.1, 0.0], (steps, 1)),
        move_sigmas=np.full((steps, 2), SIGMA),
        landmarks=np.column_stack([3.0 + row, 0.3 + column - 0.5 * side]),
        observed=(*((0, name) for name in range(landmarks)), *later),
    )
    return min(subject.cpu_seconds(world.recording()) for _ in range(2))


def _growth(subject: Subject) -> float:
    """Return the growth exponent of the step time over the last two doublings of the map, or over a single one."""
    times: list[float] = []
    landmarks = SMALLEST
    while landmarks <= LARGEST:
        short, long = (_run_seconds(subject, landmarks, steps) for steps in (1, STEPS + 1))
        times.append(max(SHORTEST, (long - short) / STEPS))
        if long > LONG and len(times) > 1:
            break
        landmarks *= 2
    last = times[-3:]
    return float(np.log2(last[-1] / last[0]) / (len(last) - 1))


@check(
    figure="growth exponent of the step time over the last two doublings of the map",
    bound=BOUND,
    blame="work per step beyond products of full matrices, for example products repeated for every landmark",
    excused_to=3.5,
    limit="products of full matrices, as in textbooks, take cubic time: right, but slow for large maps; "
    "change only the robot's rows of P in the prediction, and subtract K (H P) in the update",
)
def step_time(subject: Subject, _rng: np.random.Generator) -> float:
    """Return the smallest of up to three exponents, because idle threads of a matrix library may count as work."""
    exponent = _growth(subject)
    for _ in range(2):
        if exponent > BOUND:
            exponent = min(exponent, _growth(subject))
    return exponent
