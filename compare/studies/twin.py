"""A log's twin: a scenario with the path and the map of its optimum, its own sightings, its noise and its stamps.

Studies of the twin tell what can be expected where there is no ground truth, as far as the log's noise is what its
covariances say: the twin's is.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.estimators.loading import load
from slamgauge.compare.estimators.registry import HINDSIGHT
from slamgauge.compare.estimators.requests import ask
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.scenarios.odometry_errors import COV_HEADER
from slamgauge.compare.scenarios.schema import Association
from slamgauge.compare.scenarios.sensor_errors import sightings_header
from slamgauge.compare.scenarios.trajectory import PATH_HEADER
from slamgauge.compare.storage.covariance_columns import upper_triangles
from slamgauge.compare.storage.csv_folder import write_rows
from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.result_files import TWIN, TWIN_MOTION, TWIN_PATH, TWIN_SIGHTINGS
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS

ASSOCIATES = "riekf"  # who associates a log without ids


@dataclass(frozen=True)
class Twin:
    """What a twin is made of.

    Attributes:
        recording: the log, with ids, and without what it cannot place or associate.
        optimum: its hindsight optimum.
        landmark: (M,) number of the landmark of each observation, its row in the optimum's map.
        has_ids: whether the log's own ids were used.
        left_out: how many observations of the log the twin does without.
    """

    recording: Recording
    optimum: Estimate
    landmark: Int
    has_ids: bool
    left_out: int


def make_twin(recording: Recording) -> Twin:
    """The twin of a log; one without ids is associated jointly first.

    Raises:
        UserError: no landmark is left, or the log has no optimum.
    """
    log = recording
    if recording.landmark is None:
        association = _run(ASSOCIATES, recording, Association(method="jcbb")).association
        assert association is not None
        log = recording.associated(association)
    optimum = _run(HINDSIGHT, log)
    assert optimum.association is not None
    log = log.associated(optimum.association)
    assert log.landmark is not None
    if not len(log.landmark) or not log.steps:
        raise UserError("recording: nothing is left that a twin could see; give a longer one")
    names = np.sort(optimum.landmark_ids)
    left_out = len(recording.observation) - len(log.observation)
    return Twin(log, optimum, np.searchsorted(names, log.landmark), recording.landmark is not None, left_out)


def write_twin(folder: Path, twin: Twin, name: str) -> None:
    """Write the scenario and its three CSV files into a folder that exists.

    Args:
        folder: where to.
        twin: what.
        name: what its description calls the log.

    Raises:
        UserError: one cannot be written.
    """
    log = twin.recording
    sigmas = _common_sigmas(log)
    covs = upper_triangles(log.observation_cov).tolist() if sigmas is None else [[]] * len(log.observation)
    header = sightings_header(log.sensor, has_covs=sigmas is None)
    seen = zip(log.observation_step.tolist(), twin.landmark.tolist(), covs, strict=True)
    moved = enumerate(upper_triangles(log.odometry_cov).tolist(), 1)
    write_rows(folder / TWIN_PATH, PATH_HEADER, np.column_stack([log.stamps, twin.optimum.poses]).tolist())
    write_rows(folder / TWIN_MOTION, COV_HEADER, ([step, *cov] for step, cov in moved))
    write_rows(folder / TWIN_SIGHTINGS, header, ([step, landmark, *cov] for step, landmark, cov in seen))
    with explained(folder / TWIN, "written"):
        (folder / TWIN).write_text("\n".join(_toml(twin, name, sigmas)) + "\n", encoding="utf-8")


def _run(name: str, recording: Recording, association: Association | None = None) -> Estimate:
    return run_estimator(name, load(ask([name])[0], association), recording)[0]


def _common_sigmas(log: Recording) -> Float | None:
    """Standard deviations (d,) of all observations; None where each has a covariance that these do not tell."""
    first = log.observation_cov[0]
    is_diagonal = np.array_equal(first, np.diag(np.diag(first)))
    variances = dict(zip(SENSORS[log.sensor].sigmas, np.diag(first), strict=True))
    is_round = np.array_equal([variances[name] for name in SENSORS[log.sensor].sigmas], np.diag(first))
    is_common = (log.observation_cov == first).all()
    return np.sqrt(np.diag(first)) if is_diagonal and is_round and is_common else None


def _toml(twin: Twin, name: str, sigmas: Float | None) -> Iterable[str]:
    """The lines of the scenario."""
    log, optimum = twin.recording, twin.optimum
    places = optimum.landmarks[np.argsort(optimum.landmark_ids)]
    distance = np.linalg.norm(places[twin.landmark] - optimum.poses[log.observation_step, :2], axis=1)
    yield f"description = {json.dumps(f'Twin of {name}: path and map of its optimum', ensure_ascii=False)}"
    yield "\n[prior]"
    yield f"mean = {optimum.poses[0].tolist()}"
    yield f"covariance = {log.prior_cov.tolist()}"
    yield f'\n[trajectory]\nkind = "csv"\nfile = "{TWIN_PATH}"'
    yield f'\n[motion]\ncovariances = "{TWIN_MOTION}"'
    yield f'\n[sensor]\nkind = "{log.sensor}"\nmax_range = {math.ceil(distance.max() + 1e-9)}.0'
    yield f'sightings = "{TWIN_SIGHTINGS}"'
    yield from _sigma_lines(log, sigmas)
    if not twin.has_ids:
        yield '\n[association]\nmethod = "jcbb"'
    yield f"\n[landmarks]\npositions = {places.tolist()}"


def _sigma_lines(log: Recording, sigmas: Float | None) -> Iterable[str]:
    if sigmas is None:
        return
    model = SENSORS[log.sensor]
    units = dict(zip(model.sigmas, model.units, strict=True))
    for name, sigma in dict(zip(model.sigmas, sigmas.tolist(), strict=True)).items():
        if units[name] == "rad":
            yield f"sigma_{name}_deg = {float(np.rad2deg(sigma))!r}"
        else:
            yield f"sigma_{name} = {sigma!r}   # {units[name]}"
