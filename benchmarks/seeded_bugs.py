"""Does `slamgauge check` find each bug that is seeded into a textbook EKF, by the check that is named for it?

    python benchmarks/seeded_bugs.py [--seeds 20]

The table has a row for the right filter and for each bug: the check that is named for the bug, the number of seeds
for which it fails, and the other checks that fail.
The exit status is 1 if a named check passes, another check fails, or a
right filter fails a check.
"""

from __future__ import annotations

import sys
from collections import Counter
from functools import partial
from pathlib import Path

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).parents[1]))  # for the references

from slamgauge.compare.checks.examination import check_estimator
from slamgauge.estimate import Estimator
from tests.reference.seeded_bugs import SEEDED, seeded_ekf


def main(seeds: int = 20) -> int:
    with np.errstate(all="ignore"):  # bugs may overflow
        good = print_table({bug: (partial(seeded_ekf, bug=bug), SEEDED.get(bug, "")) for bug in ("", *SEEDED)}, seeds)
    return 0 if good else 1


def print_table(rows: dict[str, tuple[Estimator, str]], seeds: int) -> bool:
    """Print a row for each estimator and the check that is named for its bug; return whether this check alone fails."""
    print(f"{'bug':41}{'named check':23}{'caught':>8}  other checks that fail")
    good = True
    for bug, (estimator, named) in rows.items():
        broken = failures(estimator, seeds)
        others = [name for name in broken if name != named]
        good = good and (not named or broken[named] == seeds) and not others
        caught = f"{broken[named]}/{seeds}" if named else "-"
        print(f"{bug or '(none)':41}{named or '-':23}{caught:>8}  {', '.join(others) or '-'}", flush=True)
    return good


def failures(estimator: Estimator, seeds: int) -> Counter[str]:
    """Return for how many seeds each check fails."""
    verdicts = (check_estimator("mine", estimator, seed) for seed in range(seeds))
    return Counter(verdict.name for each in verdicts for verdict in each if verdict.is_failure)


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
