"""The law of the step time against the size of the map."""

from __future__ import annotations

import numpy as np

from slamgauge.compare.checks.law import Law, Subject
from slamgauge.compare.checks.small_recordings import KNOWN_START, SIGMA, World

SMALLEST, LARGEST = 20, 320  # landmarks
STEPS = 6
BOUND = 2.75
PATIENCE = 0.2  # s: a map is doubled only after a run that took no longer; the next may take 16 times that
UNNOTICED = 1e-3  # s: faster steps count as this long, as clocks and caches decide there


def _run_seconds(subject: Subject, landmarks: int, steps: int) -> float:
    """A map seen at once from the start, then a landmark at each of that many steps: the faster of two runs [s]."""
    side = int(np.ceil(np.sqrt(landmarks)))
    row, column = np.divmod(np.arange(landmarks), side)
    grid = np.column_stack([3.0 + row, 0.3 + column - 0.5 * side])
    world = World(
        start=np.zeros(3),
        prior_cov=KNOWN_START,
        moves=np.tile([0.1, 0.0], (steps, 1)),
        move_sigmas=np.full((steps, 2), SIGMA),
        landmarks=grid,
        sights=(*((0, name) for name in range(landmarks)), *((step, step % landmarks) for step in range(1, steps + 1))),
    )
    return min(subject.cpu_seconds(world.recording()) for _ in range(2))


def _growth(subject: Subject) -> float:
    """Growth exponent of the step time over the last two doublings of the map, or the one that there is."""
    times: list[float] = []
    landmarks = SMALLEST
    while landmarks <= LARGEST:
        short, long = (_run_seconds(subject, landmarks, steps) for steps in (1, STEPS + 1))
        times.append(max(UNNOTICED, (long - short) / STEPS))
        if long > PATIENCE and len(times) > 1:
            break
        landmarks *= 2
    last = times[-3:]
    return float(np.log2(last[-1] / last[0]) / (len(last) - 1))


def _smallest_growth(subject: Subject, _rng: np.random.Generator) -> float:
    """The smallest of up to three measurements: idle threads of a matrix library count as work now and then."""
    exponent = _growth(subject)
    for _ in range(2):
        if exponent > BOUND:
            exponent = min(exponent, _growth(subject))
    return exponent


SPEED = (
    Law(
        name="step-time",
        figure="growth exponent of the time of a step over the last two doublings of the map",
        bound=BOUND,
        reason="the update of P is quadratic in the map; where P outgrows the cache 2.5 is measured",
        blame="work per step beyond products of full matrices: those repeated for every landmark, seen or not",
        judge=_smallest_growth,
        excused_to=3.5,
        limit="products of full matrices, as the textbook writes them, are cubic: right, but slow with large maps; "
        "change the robot's rows of P in the prediction, and subtract K (H P) in the update",
    ),
)
