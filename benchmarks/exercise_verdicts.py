"""How often is a verdict of `slamgauge exercise` wrong, and how often is there one?

    python benchmarks/exercise_verdicts.py results/exercise [--only q1 ...] [--runs 100] [--seed 0] [--studies 1000]

Draws studies of 10 to 100 runs, with replacement, from the runs that `slamgauge exercise` has stored in a folder;
runs that it lacks are added. With `--only`, comparisons with settings of other questions are left out.

Wrong: the ratios are shifted so that their true value is the nearest end of the asserted range, where any verdict is
wrong; the sum bounds the probability that any verdict is wrong. Decided: without the shift.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import tyro

from slamgauge.compare.exercise.conclusions import judge_ratio, log_ratios
from slamgauge.compare.exercise.results import run_exercise
from slamgauge.compare.studies.executors import local_processes

RUNS = (10, 20, 50, 100)


def main(
    folder: tyro.conf.Positional[Path],
    /,
    only: tuple[str, ...] = (),
    runs: int = 100,
    seed: int = 0,
    studies: int = 1000,
) -> int:
    with local_processes(1) as executor:
        exercise = run_exercise(only, runs, seed, folder, executor)
    found = {ran.setting.figure: ran.study.loaded for ran in exercise.settings}
    rng, total = np.random.default_rng(1), np.zeros(len(RUNS))
    print(f"{studies} studies from {runs} runs; wrong and decided share with {', '.join(map(str, RUNS))} runs")
    for conclusion, _ in exercise.judgements:
        above, *others = conclusion.measures
        for below in (each for each in others if each.setting in found):
            logs = log_ratios(above, below, found)
            ends = [np.log(end) for end in conclusion.asserted if 0.0 < end < np.inf]
            shifted = logs - logs.mean() + min(ends, key=lambda end: abs(end - logs.mean()))
            shares = np.zeros((2, len(RUNS)))
            for column, count in enumerate(RUNS):
                for row, pool in enumerate((shifted, logs)):
                    drawn = pool[rng.integers(0, len(pool), (studies, count))]
                    verdicts = (judge_ratio(each, conclusion.asserted).verdict for each in drawn)
                    shares[row, column] = sum(verdict != "undecided" for verdict in verdicts) / studies
            total += shares[0]
            texts = ("  ".join(f"{share:6.2%}" for share in row) for row in shares)
            print(f"{conclusion.id:26} {below.setting}  wrong {next(texts)}   decided {next(texts)}", flush=True)
    print(f"{'sum':26}      wrong {'  '.join(f'{share:6.2%}' for share in total)}")
    return 0


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
