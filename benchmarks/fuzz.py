"""Every input of slamgauge, damaged at random: what is refused in one line, what is accepted, and what should not be.

    python benchmarks/fuzz.py [--cases 2000] [--seed 0] [--only 17] [--seconds 20] [--memory 2.5] [--worst 20]

Each case damages one input: npz, MATLAB, CSV, TOML, g2o, MRCLAM, DLR, Freiburg and Victoria Park files, estimates,
stores of studies, `--set`, or arguments of a command. A warning counts as a traceback, and so does a refusal of
several lines, but for those of scenarios, which have a line for each mistake, and of the parser of arguments. A filter
is run on recordings that were accepted. `silently altered` is what was accepted although its figures are not those
that the file states, as far as that can be told (`fuzzing/targets.py`).

Cases run in a process of limited memory [GB], which is started again when it dies or takes too long [s]. `--only`
carries one out and tells all of it. Exit status 1 if anything is a traceback, a hang, a crash or altered. An interrupt
ends with the table so far.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # Python may be told not to look there

from fuzzing.cases import ACCEPTED, OUTCOMES, REFUSED, Tried, names
from fuzzing.worker import carry_out_all
from tqdm import tqdm

from slamgauge.compare.scoring.text_table import aligned

INTERRUPTED = 130


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--memory", type=float, default=2.5)
    parser.add_argument("--worst", type=int, default=20)
    options = parser.parse_args()
    cases = range(options.cases) if options.only is None else [options.only]
    counts: Counter[tuple[str, str]] = Counter()
    bad: list[tuple[int, Tried]] = []
    all_names = names()  # made here, so that no process has to make them again
    carried = carry_out_all(options.seed, cases, options.seconds, int(1e9 * options.memory))
    status = 0
    try:
        for case, tried in tqdm(carried, total=len(cases), disable=None):
            counts[tried.target, tried.outcome] += 1
            if tried.outcome not in (REFUSED, ACCEPTED):
                bad.append((case, tried))
                tqdm.write(_told(case, tried), file=sys.stderr)
    except KeyboardInterrupt:
        status = INTERRUPTED
        print("interrupted")
    print(_table(all_names, counts))
    for case, tried in bad[: options.worst]:
        print(_told(case, tried))
    if options.only is not None and not bad:
        print(*counts)
    return status or int(bool(bad))


def _told(case: int, tried: Tried) -> str:
    return f"case {case}: {tried.target}: {tried.outcome}: {tried.detail}"


def _table(all_names: list[str], counts: Counter[tuple[str, str]]) -> str:
    rows = {name: [counts[name, outcome] for outcome in OUTCOMES] for name in all_names}
    rows["all"] = [sum(column) for column in zip(*rows.values(), strict=True)]
    cells = [[name, str(sum(row)), *map(str, row)] for name, row in rows.items()]
    return "\n".join(aligned([["input", "tried", *OUTCOMES], *cells], 1))


if __name__ == "__main__":
    sys.exit(main())
