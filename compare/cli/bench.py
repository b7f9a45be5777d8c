"""Step times of this computer: `slamgauge bench`."""

from __future__ import annotations

from slamgauge.compare.bench.step_times import bench_table, require_room_for_bench, run_bench
from slamgauge.compare.cli.options.machine import Bench
from slamgauge.compare.cli.options.shared import split_names
from slamgauge.compare.cli.steps import draw, results_folder
from slamgauge.compare.storage.files import write_json
from slamgauge.compare.storage.result_files import BENCH
from slamgauge.errors import UserError

LONGEST = 12  # digits of a map size: Python parses some thousands


def run(command: Bench) -> int:
    """Run the command; return the exit status."""
    words = [word.strip() for word in command.landmarks.split(",")]
    if not all(word.isdecimal() and len(word) <= LONGEST and int(word) > 0 for word in words):
        raise UserError(f"landmarks {command.landmarks!r:.60}: give map sizes > 0, for example 20,100")
    sizes = [int(word) for word in words]
    require_room_for_bench(sizes)
    with results_folder(command.out, BENCH) as folder:
        result = run_bench(sizes, split_names(command.estimators))
        command.output.show(result, bench_table(result))
        if folder is not None:
            write_json(folder / BENCH, result)
    if command.out is None:
        return 0

    return 0 if draw(command.out, BENCH) else 1
