"""A study as its folder holds it, read back without carrying anything out."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import STORE, SUMMARY
from slamgauge.compare.studies.store import read_store
from slamgauge.compare.studies.summary import Failure, Summary, summarise
from slamgauge.errors import UserError


class StoredStudy(NamedTuple):
    """A study.

    Attributes:
        content: of summary.json.
        summary: the same as an object, made anew of the runs; without the comparisons, which stand in `content`.
        runs: what the store holds, by label.
        step: time step [s].
    """

    content: dict[str, Any]
    summary: Summary
    runs: dict[str, Runs]
    step: float


def load_study(folder: Path) -> StoredStudy:
    """The study in a folder: the runs that its summary.json is of.

    Raises:
        UserError: there is none, or its files do not belong together.
    """
    path = folder / SUMMARY
    content = read_json(path, "study")
    try:
        labels, count, seed = [*content["estimators"]], int(content["runs"]), int(content["seed"])
        failures = tuple(Failure(**each) for each in content["failures"])
        scenario, digest = content["scenario"], content["digest"]
    except (ValueError, TypeError, KeyError):
        raise UserError(f"{path}: not what `slamgauge study` writes; run it again") from None
    step, runs = read_store(folder / STORE, digest, labels, count)
    return StoredStudy(content, Summary(scenario, count, seed, digest, failures, summarise(runs)), runs, step)
