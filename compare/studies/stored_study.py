"""A study as its folder holds it, read back without carrying anything out."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.simulation import informed
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import OPTIMA, STORE, SUMMARY
from slamgauge.compare.studies.store import digest as digest_of
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
    """The study in a folder: the runs that its summary.json is of; of a sweep's value with the optima beside it.

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
    stored, runs = read_store(folder / STORE, digest, labels, count)
    lacking = [label for label in labels if label not in runs]
    beside, of_optima = optima_beside(folder.parent, stored, seed)
    if lacking and beside.is_file():
        runs |= read_store(beside, of_optima, lacking, count)[1]
    lost = next((label for label in labels if label not in runs), None)
    if lost is not None:
        raise UserError(f"{folder / STORE}: holds no run of {lost}; give the command of the study again")
    runs = {label: runs[label] for label in labels}
    summary = Summary(scenario, count, seed, digest, failures, summarise(runs))
    return StoredStudy(content, summary, runs, stored.trajectory.step)


def optima_beside(sweep: Path, scenario: Scenario, seed: int) -> tuple[Path, str]:
    """The store in a sweep's folder that holds the optima of a scenario, and its digest.

    They are told true noise and associations, so that values at which they see the same share one.
    """
    found = digest_of(informed(scenario), seed)
    return sweep / OPTIMA / found[:12] / STORE, found
