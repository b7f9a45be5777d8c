r"""Damage every input of slamgauge at random and count what is refused, accepted, or ends as it should not.

    python benchmarks/fuzz.py [--cases 2000] [--first 0] [--seed 0] [--only 17] [--seconds 20] [--memory 2.5] \
        [--worst 20]

Each case damages one input: npz, MATLAB, CSV, TOML, g2o, MRCLAM and Victoria Park files, estimates,
stores of studies, `--set`, or arguments of a command. A warning counts as a traceback, and so does a refusal of several
lines, except refusals of scenarios (a line per mistake) and of the argument parser. A filter runs on each accepted
recording. An input is `silently altered` if it was accepted and the result differs from the content of the file
(`fuzzing/targets.py`).

Cases run in a process with limited memory [GB], which is restarted when it crashes or when a case exceeds the limit of
processor time [s]. `--first` continues an interrupted run, and `--only` runs one case. The exit status is 1 after a
traceback, a hang, a crash or an altered input. After an interrupt the program prints the table of the results so far.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # Python with PYTHONSAFEPATH does not look there

import tyro
from fuzzing.cases import ACCEPTED, OUTCOMES, REFUSED, names, run_cases
from tqdm import tqdm

from slamgauge.compare.scoring.text_page import aligned

INTERRUPTED = 130


def main(
    cases: int = 2000,
    first: int = 0,
    seed: int = 0,
    only: int | None = None,
    seconds: float = 20.0,
    memory: float = 2.5,
    worst: int = 20,
) -> int:
    numbers = range(first, cases) if only is None else [only]
    counts: Counter[tuple[str, str]] = Counter()
    bad: list[str] = []
    all_names = names()  # made here, so that child processes do not make the inputs again
    status = 0
    try:
        for case, result in tqdm(
            run_cases(seed, numbers, seconds, int(1e9 * memory)), total=len(numbers), disable=None
        ):
            counts[result.target, result.outcome] += 1
            if result.outcome not in (REFUSED, ACCEPTED):
                bad.append(f"case {case}: {result.target}: {result.outcome}: {result.detail}")
                tqdm.write(bad[-1], file=sys.stderr)
    except KeyboardInterrupt:
        status = INTERRUPTED
        print("interrupted")
    rows = {name: [counts[name, outcome] for outcome in OUTCOMES] for name in all_names}
    rows["all"] = [sum(column) for column in zip(*rows.values(), strict=True)]
    cells = [[name, str(sum(row)), *map(str, row)] for name, row in rows.items()]
    print("\n".join(aligned([["input", "tried", *OUTCOMES], *cells], {0})))
    print(*bad[:worst], sep="\n", end="\n" if bad else "")
    if only is not None and not bad:
        print(*counts)
    return status or int(bool(bad))


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
