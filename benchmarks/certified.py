"""Count how often the certified start is certified, and compare its minimum with that of `batch`.

    python benchmarks/certified.py [--recordings 300] [--seed 0] [--scenarios]

Random recordings (`references/recordings.py`) and, with `--scenarios`, the shipped scenarios. Bearing-only recordings
and those without observations have no certificate. Each recording whose certificate is not tight or whose minima differ
is listed. The last table has the processor time of the certificate, without `batch`, by the numbers of steps and
landmarks.
"""

from __future__ import annotations

from slamgauge.blas_threads import pin_blas_threads

pin_blas_threads()

import sys
from collections import defaultdict
from pathlib import Path
from time import process_time

sys.path.insert(0, str(Path(__file__).parent))  # Python with PYTHONSAFEPATH does not look there

import numpy as np
import tyro
from references.recordings import draw

from slamgauge import load_scenario, shipped_scenarios, simulate
from slamgauge.errors import UserError
from slamgauge.estimate import Certificate
from slamgauge.graph_baseline import batch
from slamgauge.graph_baseline.certified import certificate, require_certifiable
from slamgauge.recording import Recording

COSTS = "surrogate {0.surrogate_cost:.8g}, reached {0.reached_cost:.8g}, batch {0.optimum_cost:.8g}"


class Table:
    """Counts of certificates and minima, and the time by size."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = defaultdict(int)
        self.seconds: dict[tuple[int, int], list[float]] = defaultdict(list)
        self.gaps: list[float] = []

    def add(self, name: str, recording: Recording) -> None:
        """Compare both minima of a recording with ids; print a line if they differ or the gap is not tight."""
        try:
            require_certifiable(recording)
        except UserError:
            self.counts["does not apply"] += 1
            return
        optimum = batch(recording)
        start = process_time()
        found = certificate(recording, optimum)
        size = 10 ** int(np.log10(recording.steps)), 10 ** int(np.log10(len(optimum.landmark_ids)))
        self.seconds[size].append(process_time() - start)
        self.gaps.append(found.relative_gap)
        for key in verdicts(found):
            self.counts[key] += 1
        if not (found.is_tight and found.is_same_minimum):
            print(f"{name}: relative gap {found.relative_gap:.1e}, {COSTS.format(found)}", flush=True)

    def show(self) -> None:
        """Print counts, gaps and times."""
        for name, count in self.counts.items():
            print(f"{name:28}{count:6d}")
        print(f"relative gap: median {np.median(self.gaps):.1e}, largest {max(self.gaps):.1e}")
        print(f"{'steps from':>12}{'landmarks from':>16}{'recordings':>12}{'median [s]':>12}{'largest [s]':>13}")
        for (steps, landmarks), times in sorted(self.seconds.items()):
            print(f"{steps:12d}{landmarks:16d}{len(times):12d}{np.median(times):12.3f}{max(times):13.3f}")


def verdicts(found: Certificate) -> list[str]:
    """Return the counts to which a certificate adds."""
    lower = found.reached_cost < found.optimum_cost
    minimum = "same minimum" if found.is_same_minimum else f"{'lower' if lower else 'higher'} than batch"
    return ["compared", *["tight"] * found.is_tight, minimum]


def main(recordings: int = 300, seed: int = 0, scenarios: bool = False) -> None:
    table = Table()
    for name, _ in shipped_scenarios() if scenarios else []:
        truth, recording = simulate(load_scenario(name, ["start=mean"]), 0)
        assert truth.association is not None and truth.misleading is not None
        table.add(name, recording.associated(np.where(truth.misleading, -1, truth.association)))
    for number in range(recordings):
        table.add(f"seed {seed}, recording {number}", draw(seed, number).recording)
    table.show()


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
