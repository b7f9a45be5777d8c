"""Damaged stores of studies: what is read of them is what was stored, or they are refused."""

from __future__ import annotations

import contextlib
import io
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from fuzzing.mutations import changed_pages
from slamgauge.compare.storage.result_files import STORE
from slamgauge.compare.studies.study import load_runs, run_study

RUNS = 4
NAMES = ("dead-reckoning", "ekf")
Stored = dict[tuple[str, int], tuple[Any, ...]]  # figures and series by estimator and run


def damaged_stores(scenario: Any, folder: Path) -> list[dict[str, Any]]:
    """Return the input (see `targets.Target`): the store of a short study."""
    with ThreadPoolExecutor(1) as thread, contextlib.redirect_stderr(io.StringIO()):
        run_study(scenario, RUNS, 0, NAMES, folder / "study", thread)
    files = {STORE: (folder / "study" / STORE).read_bytes()}
    take, claim = partial(_read, scenario), partial(_as_stored, _read(scenario, folder / "study"))
    return [{"name": "study.sqlite", "take": take, "claim": claim, "files": files, "mutations": (changed_pages,)}]


def _read(scenario: Any, folder: Path) -> Stored:
    stored: Stored = {}
    for name, runs in load_runs(scenario, RUNS, 0, NAMES, folder).items():
        for row, run in enumerate(runs.run.tolist()):
            figures = [values[row] for key, values in runs.figures.items() if "seconds" not in key]
            stored[name, run] = (runs.kind, repr(figures), *(values[row].tobytes() for values in runs.series.values()))
    return stored


def _as_stored(whole: Stored, _: Path, found: Stored) -> str:
    other = [key for key, value in found.items() if whole.get(key) != value]
    if other:
        return f"{other[0]} is not what was stored"
    return "" if len(found) == len(whole) else f"{len(found)} rows of {len(whole)} without a message"
