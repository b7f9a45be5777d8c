"""Step times of this computer: `slamgauge bench`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from slamgauge.compare.bench import step_times
from slamgauge.compare.cli.common import Estimators, split_names, staged
from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.estimators.registry import BENCHED
from slamgauge.compare.figures import publishing
from slamgauge.compare.storage.result_files import BENCH
from slamgauge.errors import UserError

LONGEST = 12  # digits of a map size: Python parses some thousands


@dataclass
class Command:
    """Measure step times for several map sizes, next to a plain numpy filter (the four default sizes take 20 minutes).

    For example:
      slamgauge bench --landmarks 20,100 --estimators ekf,riekf

    Attributes:
        landmarks: Comma-separated map sizes.
        out: Folder of bench.json, bench.png and bench.svg. Without it they are not written.
    """

    landmarks: str = "20,100,300,1000"
    estimators: Estimators = BENCHED
    out: Path | None = None
    output: Output = field(default_factory=Output)

    def run(self) -> int:
        words = [word.strip() for word in self.landmarks.split(",")]
        if not all(word.isdecimal() and len(word) <= LONGEST and int(word) > 0 for word in words):
            raise UserError(f"landmarks {self.landmarks!r:.60}: give map sizes > 0, for example 20,100")
        sizes = [int(word) for word in words]
        with staged(self.out, BENCH) as folder:
            result = step_times.run_bench(sizes, split_names(self.estimators))
            self.output.show(result, step_times.bench_table(result), folder and folder / BENCH)
        return 0 if self.out is None or publishing.draw_stored(self.out, BENCH) else 1
