"""Check of the growth of the step time with the number of landmarks L.

The step time is the difference of the processor times of a run with 7 steps and a run with 1 step, divided by 6. It is
measured for L = 20, 40, 80 and 160. If it grows as L^p, the growth exponent is p.
"""

from __future__ import annotations

import numpy as np

from slamgauge.compare.checks.check import Subject, check
from slamgauge.compare.checks.small_recordings import SIGMA, World

# landmarks; at 160, what grows faster than L^3 takes far longer than SHORTEST: 160 products of full matrices need 0.5 s
SMALLEST, LARGEST = 20, 160
STEPS = 6
BOUND = 2.75
LONG = 0.2  # s; the map is not doubled after a longer run, because the next may take 16 times as long
SHORTEST = 1e-3  # s; replaces smaller step times, because these depend on clocks and caches


def _run_seconds(subject: Subject, landmarks: int, steps: int) -> float:
    """Return the processor time [s] of a run.

    The scan of step 0 observes all landmarks; each later scan observes one.
    """
    side = int(np.ceil(np.sqrt(landmarks)))
    row, column = np.divmod(np.arange(landmarks), side)
    later = ((step, step % landmarks) for step in range(1, steps + 1))
    world = World(
        moves=np.tile([0.1, 0.0], (steps, 1)),
        move_sigmas=np.full((steps, 2), SIGMA),
        landmarks=np.column_stack([3.0 + row, 0.3 + column - 0.5 * side]),
        observed=(*((0, name) for name in range(landmarks)), *later),
    )
    return subject.cpu_seconds(world.recording())


def _growth(subject: Subject) -> float:
    """Return the growth exponent of the step time over the last two doublings of the map.

    If the second map already takes longer than LONG, only one doubling was measured, and the exponent is over this one.
    """
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
    """Return the growth exponent; above the bound, the smallest of up to three measured exponents.

    The measurement is repeated because the time of idle threads of a matrix library may count as work.
    """
    exponent = _growth(subject)
    for _ in range(2):
        if exponent > BOUND:
            exponent = min(exponent, _growth(subject))
    return exponent
