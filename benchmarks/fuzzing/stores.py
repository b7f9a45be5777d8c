"""Stores of studies, damaged: what is read of them, as they are and mended, is what was stored."""

from __future__ import annotations

import contextlib
import io
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from fuzzing.mutations import changed_pages
from slamgauge.compare.storage.result_files import STORE
from slamgauge.compare.studies.store_damage import mend_store
from slamgauge.compare.studies.study import load_runs, run_study

RUNS = 4
NAMES = ("dead-reckoning", "ekf")
Stored = dict[tuple[str, int], tuple[Any, ...]]  # figures and series by estimator and run


def damaged_stores(scenario: Any, folder: Path) -> list[dict[str, Any]]:
    """The inputs (see `targets.Target`): a store that is read, and one that is mended before."""
    with ThreadPoolExecutor(1) as thread, contextlib.redirect_stderr(io.StringIO()):
        run_study(scenario, RUNS, 0, NAMES, folder / "study", thread)
    files = {STORE: (folder / "study" / STORE).read_bytes()}
    whole = _read(scenario, folder / "study")
    read, mend = partial(_read, scenario), partial(_mended, scenario)
    common = {"files": files, "mutations": (changed_pages,)}
    return [
        {"name": "study.sqlite", "take": read, "claim": partial(_as_stored, whole, len(whole)), **common},
        {"name": "study.sqlite mended", "take": mend, "claim": partial(_as_stored, whole, 0), **common},
    ]


def _read(scenario: Any, folder: Path) -> Stored:
    stored: Stored = {}
    for name, runs in load_runs(scenario, RUNS, 0, NAMES, folder).items():
        for row, run in enumerate(runs.run.tolist()):
            figures = [values[row] for key, values in runs.figures.items() if "seconds" not in key]
            stored[name, run] = (runs.kind, repr(figures), *(values[row].tobytes() for values in runs.series.values()))
    return stored


def _mended(scenario: Any, folder: Path) -> Stored:
    with contextlib.redirect_stderr(io.StringIO()):
        mend_store(folder / STORE)
    return _read(scenario, folder)


def _as_stored(whole: Stored, fewest: int, _: Path, found: Stored) -> str:
    other = [key for key, value in found.items() if whole.get(key) != value]
    if other:
        return f"{other[0]} is not what was stored"
    return "" if len(found) >= fewest else f"{len(found)} rows of {fewest}, without a word"
