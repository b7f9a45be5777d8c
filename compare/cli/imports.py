"""Recordings from other programs: `slamgauge import FORMAT`."""

from __future__ import annotations

import sys
from typing import Any

from slamgauge.compare.cli.options.imports import Bag, Csv, Format, G2o, Import, LostInTheWoods, Mrclam, VictoriaPark
from slamgauge.compare.cli.options.shared import flattened, named_after
from slamgauge.compare.datasets.bag_log import read_bag, topics_text
from slamgauge.compare.datasets.csv_log import read_csv_log
from slamgauge.compare.datasets.g2o import read_g2o, read_victoria_park
from slamgauge.compare.datasets.imported_log import Imported
from slamgauge.compare.datasets.lost_in_the_woods import read_lost_in_the_woods
from slamgauge.compare.datasets.mrclam import read_mrclam
from slamgauge.compare.storage.files import save
from slamgauge.compare.storage.result_files import MAPPING, RECORDING, TRUTH
from slamgauge.compare.storage.staged_folder import require_ours, staged_folder
from slamgauge.compare.storage.toml_tables import write_toml


def run(command: Import) -> None:
    """Print the topics of a bag, or import a log and write its files."""
    given = command.format
    if isinstance(given, Bag) and given.topics:
        print(topics_text(given.path, given.msgs))
        return
    out = named_after(given.out, given.path)
    require_ours(out)  # before long files are read
    log = _read(given)
    recording, truth, mapping = log.recording, log.truth, log.mapping
    from slamgauge.compare.datasets.plausibility import examine  # loads kernels, which a refusal need not wait for

    facts, doubts = examine(log, given.path)
    with staged_folder(out, RECORDING) as folder:
        save(folder / RECORDING, recording)
        if truth is not None:
            save(folder / TRUTH, truth)
        if mapping is not None:
            write_toml(folder / MAPPING, mapping)
    table = [f"{name:<34}{value}" for name, value in facts.items()]
    warnings = [f"warning: {doubt}" for doubt in doubts]
    counts = f"{recording.steps} steps, {len(recording.observation)} observations"
    written = f"{counts}, {'with' if truth is not None else 'no'} ground truth: written to {out}"
    print(*log.notes, *table, *warnings, written, sep="\n", file=sys.stderr)


def _read(given: Format) -> Imported:
    """Read the file or folder by the reader of its format; the options are the reader's keyword arguments."""
    options: dict[str, Any] = {name: value for name, value in vars(given).items() if name not in ("path", "out")}
    match given:
        case Csv():
            return read_csv_log(given.path, flattened(given.set))
        case Bag():
            return read_bag(given.path, given.mapping, flattened(given.set), given.msgs)
        case G2o():
            return read_g2o(given.path, **options)
        case Mrclam():
            return read_mrclam(given.path, **options)
        case VictoriaPark():
            return Imported(read_victoria_park(given.path, **options))
        case LostInTheWoods():
            return Imported(*read_lost_in_the_woods(given.path, **options))
    raise AssertionError(given)
