"""Which law of `slamgauge check` catches which bug, seeded one at a time into a textbook EKF; one table.

    python benchmarks/seeded_bugs.py [--seeds 20]

A line for the right filter and for each bug: the law that is named for it, over how many seeds that law catches it, and
what other laws it breaks. `step-time` is left out, as it takes the time of the others together.
The exit status is 1 if a bug gets away, or breaks a law that is not known to be related, or the right filter fails.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))  # Python may be told not to look there

from references.seeded_bugs import SEEDED, seeded_ekf

from slamgauge.compare.checks.examination import LAWS, check_estimator

JUDGED = [law for law in LAWS if law.name != "step-time"]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    seeds = parser.parse_args(arguments).seeds
    print(f"{'bug':41}{'named law':23}{'caught':>8}  others that it breaks")
    good = True
    with np.errstate(all="ignore"):  # bugs may overflow
        for bug in ("", *SEEDED):
            named, related = SEEDED.get(bug, ("", ""))
            broken = failures(bug, seeds)
            others = [name for name in broken if name != named]
            good = good and (not bug or broken[named] == seeds) and {*others} <= {*related.split()}
            caught = f"{broken[named]}/{seeds}" if bug else "-"
            print(f"{bug or '(none)':41}{named or '-':23}{caught:>8}  {', '.join(others) or '-'}", flush=True)
    return 0 if good else 1


def failures(bug: str, seeds: int) -> Counter[str]:
    """Over how many seeds each law fails."""
    verdicts = (check_estimator(bug, partial(seeded_ekf, bug=bug), seed, JUDGED) for seed in range(seeds))
    return Counter(verdict.name for each in verdicts for verdict in each if verdict.is_failure)


if __name__ == "__main__":
    sys.exit(main())
