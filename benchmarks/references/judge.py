"""One recording, and all that is said about the estimators on it."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from references.filters import judge_filters
from references.optima import judge_optima
from references.recordings import draw
from references.verdicts import Judged


def judge(seed: int, number: int) -> Judged:
    """Draw a recording and hold every estimator against its referee."""
    begin = perf_counter()
    drawn = draw(seed, number)
    with np.errstate(all="ignore"):  # what overflows in a diverging start is not finite, and is seen by that
        outcomes = [*judge_filters(drawn.recording), *judge_optima(drawn)]
    return Judged(seed, number, drawn.recording.steps, drawn.tags, outcomes, perf_counter() - begin)
