"""How well does each estimator agree with an independent reference on random recordings?

    python benchmarks/agreement.py [--recordings 200] [--seed 0] [--only 17] [--jobs 2]

`tests/reference/drawn_recordings.py` draws recordings of all kinds. The references are: textbook filters, and for
`iekf` also the gradient of its cost; a damped least-squares solver with several starts for `batch`; the optimum of the
measurements up to each step for `causal`. Bearing-only filters have no reference: they must run without an error.

A result is `undecided` if the reference has no answer either: double precision is exhausted, or no minimum exists. Each
worse or failed result is printed on stderr with number, seed and tags; `--only` takes one recording.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from functools import partial
from pathlib import Path
from time import perf_counter

sys.path.insert(0, str(Path(__file__).parents[1]))  # for the references

import numpy as np
import tyro
from tqdm import tqdm

from slamgauge import local_processes
from tests.reference.agreement import Judged, bad_ones, describe, table
from tests.reference.drawn_recordings import draw
from tests.reference.filter_agreement import judge_filters
from tests.reference.optimum_agreement import judge_optima


def main(recordings: int = 200, seed: int = 0, only: int | None = None, jobs: int = 2) -> int:
    numbers = range(recordings) if only is None else [only]
    judged: list[Judged] = []
    for each in tqdm(judge_all(seed, numbers, jobs), total=len(numbers), disable=None):
        judged.append(each)
        for outcome in each.outcomes if only is not None else bad_ones(each):
            tqdm.write(describe(each, outcome), file=sys.stderr)
    seconds = sum(each.seconds for each in judged)
    print(f"{len(judged)} recordings, {seconds / max(1, len(judged)):.2f} s each\n")
    print(table(judged))
    return 0


def judge_all(seed: int, numbers: Sequence[int], jobs: int) -> Iterator[Judged]:
    """Yield the results of these recordings as they are ready; one job runs in this process."""
    if jobs == 1 or len(numbers) <= 1:
        yield from map(partial(judge, seed), numbers)
        return
    with local_processes(jobs) as executor:
        for future in as_completed([executor.submit(judge, seed, number) for number in numbers]):
            yield future.result()


def judge(seed: int, number: int) -> Judged:
    """Draw a recording and compare every estimator with its reference."""
    begin = perf_counter()
    drawn = draw(seed, number)
    with np.errstate(all="ignore"):  # a diverging start may overflow; the comparisons find values that are not finite
        outcomes = [*judge_filters(drawn.recording), *judge_optima(drawn)]
    return Judged(seed, number, drawn.recording.steps, drawn.tags, outcomes, perf_counter() - begin)


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
