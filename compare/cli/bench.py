"""`slamgauge bench`."""

from __future__ import annotations

from dataclasses import dataclass, field

from slamgauge.compare.cli.options import (
    Estimators,
    Folder,
    print_result,
    results_folder,
    split_names,
)
from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.estimators.registry import BENCHED
from slamgauge.errors import UserError

LONGEST = 12  # digits of a map size: Python reads thousands


@dataclass
class Bench:
    """Measure step times against map size, beside a plain numpy filter (all at four sizes: twenty minutes).

    For example:
      slamgauge bench --landmarks 20,100 --estimators ekf,riekf
    """

    landmarks: str = "20,100,300,1000"
    """Comma-separated map sizes."""

    estimators: Estimators = BENCHED

    out: Folder | None = None
    """Folder for bench.json, bench.png and bench.svg."""

    output: Output = field(default_factory=Output)

    def __call__(self) -> int:
        """Measure, print and, if asked to, write; the exit status."""
        from slamgauge.compare.bench.step_times import bench_table, require_room_for_bench, run_bench
        from slamgauge.compare.storage.files import write_json
        from slamgauge.compare.storage.result_files import BENCH, BENCH_FILES

        words = [word.strip() for word in self.landmarks.split(",")]
        if not all(word.isdecimal() and len(word) <= LONGEST and int(word) > 0 for word in words):
            raise UserError(f"landmarks {self.landmarks!r:.60}: give map sizes > 0, for example 20,100")
        sizes = [int(word) for word in words]
        require_room_for_bench(sizes)
        with results_folder(self.out, BENCH_FILES, last=BENCH) as folder:
            result = run_bench(sizes, split_names(self.estimators))
            done = print_result(result if self.output.json else bench_table(result))
            if folder is not None:
                write_json(folder / BENCH, result)
        if self.out is not None:
            from slamgauge.compare.figures.publishing import draw_stored

            done = draw_stored(self.out, BENCH) and done
        return 0 if done else 1
