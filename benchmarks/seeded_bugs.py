"""Seed bugs into a textbook EKF and into files of five forms, and print which check of `slamgauge check` fails.

    python benchmarks/seeded_bugs.py [--seeds 20] [--forms 2]

The tables have a row for each right filter and for each bug: the check that is named for the bug, the number of seeds
for which it fails, and the other checks that fail.
`--forms` is the number of seeds for the files. The exit status is 1 if a named check passes, another check fails, or a
right filter fails a check.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from functools import partial
from pathlib import Path

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).parent))  # Python with PYTHONSAFEPATH does not look there

from references.class_files import FORMS, submissions
from references.seeded_bugs import SEEDED, seeded_ekf

from slamgauge.compare.checks.examination import check_estimator
from slamgauge.compare.estimators.adapters import adapted, found_in
from slamgauge.compare.estimators.user_code import address
from slamgauge.estimate import Estimator

NAMED = {  # bugs of `class_files.BUGS`
    "right": "",
    "sign in F": "prediction-jacobian",
    "noise frame": "odometry-noise-frame",
    "sign in H": "update-bearing",
    "no wrap": "innovation-wrap",
    "R twice": "measurement-noise",
    "no heading in place": "truth-recovered",
    "half gain in P": "sound-covariances",
}
NAMED_ELSEWHERE = {("Octave course", "half gain in P"): "first-sight"}  # landmarks are in the state from the start


def main(seeds: int = 20, forms: int = 2) -> int:
    with np.errstate(all="ignore"):  # bugs may overflow
        good = print_table({bug: (partial(seeded_ekf, bug=bug), SEEDED.get(bug, "")) for bug in ("", *SEEDED)}, seeds)
        with tempfile.TemporaryDirectory() as folder:
            good = print_table(files(Path(folder)), forms) and good
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


def files(folder: Path) -> dict[str, tuple[Estimator, str]]:
    """Write the made-up files of all forms, and return their estimators with the check that is named for the bug."""
    found: dict[str, tuple[Estimator, str]] = {}
    for (form, bug), text in submissions().items():
        if form in FORMS:
            file = folder / f"{form} {bug}.py".replace(" ", "_")
            file.write_text(text, encoding="utf-8")
            estimator, _ = adapted(found_in(address(str(file))))
            found[f"{form}: {bug}"] = estimator, NAMED_ELSEWHERE.get((form, bug), NAMED[bug])
    return found


def failures(estimator: Estimator, seeds: int) -> Counter[str]:
    """Return for how many seeds each check fails."""
    verdicts = (check_estimator("mine", estimator, seed) for seed in range(seeds))
    return Counter(verdict.name for each in verdicts for verdict in each if verdict.is_failure)


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
