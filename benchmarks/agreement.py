"""Compare each estimator with an independent reference on random recordings and print one table.

    python benchmarks/agreement.py [--recordings 200] [--seed 0] [--only 17] [--jobs 2] [--worst 3]
                                   [--save FOLDER] [--check] [--misfits]

`references/recordings.py` draws recordings of all kinds. The references are: textbook filters and extended precision
for the filters, and for `iekf` also the gradient of its cost; a damped least-squares solver with several starts for
`batch`; the optimum of the measurements up to each step for `causal`. Bearing-only filters have no reference: they must
run without an error.

A result is `undecided` if the reference has no answer either: double precision is exhausted, or no minimum exists.
`--misfits` compares the processor time of `batch` and `causal` on logs with misread ids, outliers and wrong noise with
that on the same log without them (`references/misfits.py`), after the random recordings.

The program prints each worse or failed result on stderr at once, and at the end the worst cases with number, seed and
tags. `--only` takes one recording, `--save` writes recordings and truths of the worst cases, and `--check` sets exit
status 1 if an estimator misses a bar. After an interrupt the program prints the table of the results so far.
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

sys.path.insert(0, str(Path(__file__).parent))  # Python with PYTHONSAFEPATH does not look there

import numpy as np
import tyro
from references.filters import judge_filters
from references.misfits import judge_misfits, misfit_bars, misfit_table
from references.optima import judge_optima
from references.recordings import draw
from references.table import bad_ones, bars_missed, describe, messages, table, worst_cases
from references.verdicts import Judged, Outcome
from tqdm import tqdm

from slamgauge import local_processes
from slamgauge.compare.storage.files import save as save_record

INTERRUPTED = 130


def main(
    recordings: int = 200,
    seed: int = 0,
    only: int | None = None,
    jobs: int = 2,
    worst: int = 3,
    save: Path | None = None,
    check: bool = False,
    misfits: bool = False,
) -> int:
    numbers = range(recordings) if only is None else [only]
    judged: list[Judged] = []
    status = 0
    try:
        for each in tqdm(judge_all(seed, numbers, jobs), total=len(numbers), disable=None):
            judged.append(each)
            for outcome in bad_ones(each):
                tqdm.write(describe(each, outcome), file=sys.stderr)
    except KeyboardInterrupt:
        status = INTERRUPTED
        print("interrupted")
    judged.sort(key=lambda each: each.number)
    cases = worst_cases(judged, worst)
    print_all(judged, cases)
    missed = bars_missed(judged)
    if misfits:
        logs = list(judge_misfits())
        print("", misfit_table(logs), sep="\n")
        missed += misfit_bars(logs)
    print("\nbars missed:" if missed else "\nbars missed: none", *missed, sep="\n  ")
    if save is not None:
        save.mkdir(parents=True, exist_ok=True)
        for number in {each.number for each, _ in cases}:
            drawn = draw(seed, number)
            save_record(save / f"recording-{seed}-{number}.npz", drawn.recording)
            save_record(save / f"truth-{seed}-{number}.npz", drawn.truth)
    return status or int(check and bool(missed))


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


def print_all(judged: Sequence[Judged], worst: Sequence[tuple[Judged, Outcome]]) -> None:
    seconds = sum(each.seconds for each in judged)
    print(f"{len(judged)} recordings, {seconds / max(1, len(judged)):.2f} s each\n")
    print(table(judged))
    if failed := messages(judged):
        print("\nfailed:", *failed, sep="\n")
    if worst:
        print("\nworst cases:", *(describe(*each) for each in worst), sep="\n")
    if len(judged) == 1:
        print("\nall of it:", *(describe(judged[0], each) for each in judged[0].outcomes), sep="\n")


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
