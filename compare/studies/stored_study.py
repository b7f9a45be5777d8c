"""A study read from its folder, without running anything."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from pydantic import TypeAdapter

from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.simulation import informed
from slamgauge.compare.scoring.intervals import Paired
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import OPTIMA, STORE, SUMMARY
from slamgauge.compare.studies.store import digest as digest_of
from slamgauge.compare.studies.store import read_store
from slamgauge.compare.studies.summary import Failure, Request, Summary, summarise
from slamgauge.errors import UserError


class StoredStudy(NamedTuple):
    """A study read from its folder.

    Attributes:
        content: content of summary.json.
        summary: summary computed from the runs.
        runs: stored runs by label.
        step: time step [s].
    """

    content: dict[str, Any]
    summary: Summary
    runs: dict[str, Runs]
    step: float


def load_study(folder: Path) -> StoredStudy:
    """Read the study in a folder; in a sweep, the runs of the optima are in the folder `optimum` next to it.

    Raises:
        UserError: the folder has no study, or files of different studies.
    """
    path = folder / SUMMARY
    content = read_json(path, "study")
    try:
        labels, count, seed = [*content["estimators"]], int(content["runs"]), int(content["seed"])
        failures = tuple(Failure(**each) for each in content["failures"])
        scenario, digest = content["scenario"], content["digest"]
        against = TypeAdapter(dict[str, dict[str, dict[str, Paired]]]).validate_python(content["against"])
        request = TypeAdapter(Request | None).validate_python(content["request"])
    except (ValueError, TypeError, KeyError):
        raise UserError(f"{path}: not what `slamgauge study` writes; run it again") from None
    stored, runs = read_store(folder / STORE, digest, labels, count)
    missing = [label for label in labels if label not in runs]
    optima, digest_of_optima = optima_beside(folder.parent, stored, seed)
    if missing and optima.is_file():
        runs |= read_store(optima, digest_of_optima, missing, count)[1]
    for label in labels:
        if label not in runs:
            raise UserError(f"{folder / STORE}: has no run of {label}; give the command of the study again")
    runs = {label: runs[label] for label in labels}
    summary = Summary(scenario, count, seed, digest, failures, summarise(runs), against, request=request)
    return StoredStudy(content, summary, runs, stored.trajectory.step)


def optima_beside(sweep: Path, scenario: Scenario, seed: int) -> tuple[Path, str]:
    """Return the store in a sweep's folder with the optima of a scenario, and its digest.

    The optima receive true noise and associations: values of the swept key with the same measurements share a store.
    """
    found = digest_of(informed(scenario), seed)
    return sweep / OPTIMA / found[:12] / STORE, found
