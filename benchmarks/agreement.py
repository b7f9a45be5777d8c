"""Whether the estimators are right on recordings that nobody has chosen: each against a referee; one table.

    python benchmarks/agreement.py [--recordings 200] [--seed 0] [--only 17] [--jobs 2] [--worst 3]
                                   [--keep F] [--save D] [--check]

Draws recordings of every kind (see `references/recordings.py`). Filters are held against textbook filters and extended
precision, and iekf against the gradient of its own cost; batch against a damped least-squares solver that starts from
several places; causal, at every step, against the optimum of what had been measured by then. With bearings alone the
filters' rays have no twin: they must run.

`undecided` are those on which the referee has no answer either: double precision is exhausted, or there is no minimum.
What is worse, or failed, is told on stderr at once, the worst cases in the end, with number, seed and tags: `--only`
makes one of them alone, and `--save` writes their recordings and truths. `--check` ends with status 1 if a bar is
missed. An interrupt ends with the table so far; with `--keep` what has been judged is kept in a file, and the next run
with it goes on from there.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # Python may be told not to look there

from references.judge import judge
from references.kept import Kept
from references.recordings import draw
from references.table import bad_ones, bars_missed, describe, messages, table, worst_cases
from references.verdicts import Judged, Outcome
from tqdm import tqdm

from slamgauge import local_processes
from slamgauge.compare.storage.files import save

INTERRUPTED = 130


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--worst", type=int, default=3)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--save", type=Path)
    parser.add_argument("--check", action="store_true")
    options = parser.parse_args()
    numbers = range(options.recordings) if options.only is None else [options.only]
    kept = None if options.keep is None else Kept(options.keep, options.seed)
    judged = [each for each in kept.judged if each.number in numbers] if kept is not None else []
    left = [*{*numbers} - {each.number for each in judged}]
    status = 0
    try:
        for each in tqdm(_all(options.seed, left, options.jobs), total=len(left), disable=None):
            judged.append(each)
            if kept is not None:
                kept.keep(each)
            for outcome in bad_ones(each):
                tqdm.write(describe(each, outcome), file=sys.stderr)
    except KeyboardInterrupt:
        status = INTERRUPTED
        print("interrupted")
    judged.sort(key=lambda each: each.number)
    worst = worst_cases(judged, options.worst)
    _print_all(judged, worst)
    missed = bars_missed(judged)
    print("\nbars missed:" if missed else "\nbars missed: none", *missed, sep="\n  ")
    if options.save is not None:
        _save(options.save, worst)
    return status or int(options.check and bool(missed))


def _all(seed: int, numbers: Sequence[int], jobs: int) -> Iterator[Judged]:
    """The recordings of these numbers, judged, as they are ready; by this process alone if one job is all there is."""
    if jobs == 1 or len(numbers) <= 1:
        yield from map(partial(judge, seed), numbers)
        return
    with local_processes(jobs) as executor:
        for future in as_completed([executor.submit(judge, seed, number) for number in numbers]):
            yield future.result()


def _print_all(judged: Sequence[Judged], worst: Sequence[tuple[Judged, Outcome]]) -> None:
    seconds = sum(each.seconds for each in judged)
    print(f"{len(judged)} recordings, {seconds / max(1, len(judged)):.2f} s each\n")
    print(table(judged))
    failed = messages(judged)
    if failed:
        print("\nfailed:", *failed, sep="\n")
    if worst:
        print("\nworst cases:", *(describe(*each) for each in worst), sep="\n")
    if len(judged) == 1:
        print("\nall of it:", *(describe(judged[0], each) for each in judged[0].outcomes), sep="\n")


def _save(folder: Path, worst: Sequence[tuple[Judged, Outcome]]) -> None:
    """Write recording and truth of each worst case."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed, number in sorted({(each.seed, each.number) for each, _ in worst}):
        drawn = draw(seed, number)
        save(folder / f"recording-{seed}-{number}.npz", drawn.recording)
        save(folder / f"truth-{seed}-{number}.npz", drawn.truth)


if __name__ == "__main__":
    sys.exit(main())
