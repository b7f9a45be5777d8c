"""How often does `slamgauge import` name a wrong cause, or none, for mistakes of units, signs, frames and clocks?

    python benchmarks/import_causes.py [--seeds 50]

Simulated logs of 30 s with ground truth have one mistake each, or none. Their sensor noise is the stated one, or 15 %
larger or smaller.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).parents[1]))  # for `tests.reference`

from slamgauge.compare.datasets.csv_log import read_csv_log
from slamgauge.compare.datasets.plausibility import examine
from slamgauge.errors import UserError
from tests.reference.log_changes import (
    ALL,
    ODOMETRY,
    SEEN,
    TRUTH,
    Change,
    Files,
    both,
    good_log,
    moved,
    scaled,
    settings,
)

DEGREE = 180.0 / np.pi
NOISES = {"exact": 1.0, "15 % larger": 1.15, "15 % smaller": 0.85}
IN_MM = settings("[observations]\nlength = 'mm'\n[odometry]\nlength = 'mm'\n")
CAUSES = (
    *("opposite directions", "read as rad", "read as degrees", "times too", "their stamps are", "a full turn"),
    *("the odometry; add", "times the turns", "times the distances", "the units of"),
)
MISTAKES: dict[str, tuple[Change, str]] = {  # change of the files, and the cause
    "none": (both(), ""),
    "bearings are clockwise": (scaled(SEEN, bearing=-1.0), "opposite directions"),
    "turns are clockwise": (scaled(ODOMETRY, omega=-1.0), "opposite directions"),
    "bearings are in degrees": (scaled(SEEN, bearing=DEGREE), "a full turn"),
    "bearings are in radians, read as degrees": (scaled(SEEN, bearing=1 / DEGREE), "bearings are in radians"),
    "both are in radians, read as degrees": (
        both(scaled(SEEN, bearing=1 / DEGREE), scaled(ODOMETRY, omega=1 / DEGREE)),
        "bearings and turns are in radians",
    ),
    "yaw rates are in deg/s": (scaled(ODOMETRY, omega=DEGREE), "yaw rates are in deg/s"),
    "turns are in radians, read as degrees": (scaled(ODOMETRY, omega=1 / DEGREE), "turns are in radians"),
    "ranges are in mm": (scaled(SEEN, range=1e3), "observed lengths are 1000 times too large"),
    "ranges are in cm": (scaled(SEEN, range=1e2), "observed lengths are 100 times too large"),
    "speeds are in mm/s": (scaled(ODOMETRY, v=1e3), "distances of the odometry are 1000 times too large"),
    "speeds are in cm/s": (scaled(ODOMETRY, v=1e2), "distances of the odometry are 100 times too large"),
    "ranges and speeds are in mm": (
        both(scaled(SEEN, range=1e3), scaled(ODOMETRY, v=1e3)),
        "all lengths are 1000 times too large",
    ),
    "ranges and speeds are in m, read as mm": (IN_MM, "times the distances of the odometry"),
    "all stamps are in ms": (both(*(scaled(file, stamp=1e3) for file in ALL)), "the units of angles and stamps"),
    "stamps of observations are 1 s late": (moved(SEEN, "stamp", 1.0), "their stamps are 1 s late"),
    "stamps of observations are 1 s early": (moved(SEEN, "stamp", -1.0), "their stamps are 1 s early"),
    "stamps of observations are 3 s late": (moved(SEEN, "stamp", 3.0), "their stamps are 3 s late"),
    "stamps of the truth are 0.3 s early": (moved(TRUTH, "stamp", -0.3), "turns 0.3 s before the odometry"),
    "stamps of the truth are 2 s early": (moved(TRUTH, "stamp", -2.0), "turns 2 s before the odometry"),
}


def main(seeds: int = 50) -> int:
    """Print the rates."""
    print(f"{seeds} logs for each mistake and noise: right cause, another cause, no cause\n")
    print(f"{'mistake':<41}" + "".join(f"{name:>18}" for name in NOISES))
    for mistake, (change, cause) in MISTAKES.items():
        shares = list[str]()
        for noise in NOISES.values():
            found = Counter(outcome(change(good_log(100 + seed, noise=noise)), cause) for seed in range(seeds))
            shares.append(" ".join(f"{found[each] / seeds:4.0%}" for each in ("right", "other", "none")))
        print(f"{mistake:<41}" + "".join(f"{each:>18}" for each in shares), flush=True)
    return 0


def outcome(files: Files, cause: str) -> str:
    """Return whether the import names the right cause, another one, or none; without a mistake "none" is right."""
    said = import_of(files)
    if cause and cause in said:
        return "right"
    if any(each in said for each in CAUSES):
        return "other"
    return "none" if cause else "right"


def import_of(files: Files) -> str:
    """Return the refusal of a log, or the warnings about it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, content in files.items():
            (folder / file).write_text(content)
        try:
            return "\n".join(examine(read_csv_log(folder), folder)[1])
        except UserError as error:
            return str(error)


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
