"""How well does each estimator agree with an independent reference on random recordings?

    python benchmarks/agreement.py [--recordings 200] [--seed 0] [--only 17] [--jobs 2]

`tests/reference/drawn_recordings.py` draws recordings of all kinds. The references are: textbook filters; a
damped least-squares solver with several starts for `batch`; the optimum of the measurements up to each step for
`causal`. Bearing-only filters have no reference: they must run without an error.

A result is `undecided` if the reference has no answer either: double precision is exhausted, or no minimum exists. Each
worse or failed result is printed on stderr with number, seed and tags; `--only` takes one recording.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # for the references

import numpy as np
import tyro
from tqdm import tqdm

from slamgauge import local_processes
from tests.reference.agreement import Outcome, judge_filters, table
from tests.reference.drawn_recordings import draw
from tests.reference.optimum_agreement import judge_optima


def main(recordings: int = 200, seed: int = 0, only: int | None = None, jobs: int = 2) -> int:
    numbers, found = range(recordings) if only is None else [only], list[Outcome]()
    with local_processes(jobs) as executor:
        judged = executor.map(partial(judge, seed), numbers)
        for number, outcomes in zip(numbers, tqdm(judged, total=len(numbers), disable=None), strict=True):
            found += outcomes
            for each in outcomes:
                if only is not None or each.verdict in ("worse", "failed"):
                    head = f"{each.estimator} {each.verdict} {each.difference:.1e}"
                    tags = ", ".join(draw(seed, number).tags)
                    tqdm.write(f"{head:36} --seed {seed} --only {number}: {tags}\n    {each.note}", file=sys.stderr)
    print(f"{len(numbers)} recordings\n")
    print(table(found))
    return 0


def judge(seed: int, number: int) -> list[Outcome]:
    """Draw a recording and compare every estimator with its reference."""
    drawn = draw(seed, number)
    with np.errstate(all="ignore"):  # a diverging start may overflow; the comparisons find values that are not finite
        return [*judge_filters(drawn.recording), *judge_optima(drawn)]


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
