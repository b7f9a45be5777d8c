"""The twin of a log: a scenario with path and map of its optimum, and with its sightings, noise and stamps.

Studies of the twin predict errors where no ground truth exists, provided that the log's noise has the covariances that
the log states.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slamgauge.arrays import Int
from slamgauge.compare.estimators.loading import load
from slamgauge.compare.estimators.registry import HINDSIGHT
from slamgauge.compare.estimators.requests import ask
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.scenarios.measurement_errors import COV_HEADER, sightings_header
from slamgauge.compare.scenarios.schema import Association
from slamgauge.compare.scenarios.trajectory import PATH_HEADER
from slamgauge.compare.storage.csv_folder import upper_triangles, write_rows
from slamgauge.compare.storage.files import write_toml
from slamgauge.compare.storage.result_files import TWIN, TWIN_MOTION, TWIN_PATH, TWIN_SIGHTINGS
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS

ASSOCIATES = "riekf"  # estimator that associates a log without ids


@dataclass(frozen=True)
class Twin:
    """A twin of a log."""

    recording: Recording  # the log with ids, without observations of landmarks that the optimum lacks
    optimum: Estimate  # the hindsight optimum
    landmark: Int  # (M,) number of the landmark of each observation, in the order of the optimum's ids
    has_ids: bool  # whether the log has ids
    left_out: int  # number of observations that the twin lacks


def make_twin(recording: Recording) -> Twin:
    """Make the twin of a log; a log without ids is associated jointly first.

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
        raise UserError("recording: no observation is left for a twin; give a longer one")
    names = np.sort(optimum.landmark_ids)
    left_out = len(recording.observation) - len(log.observation)
    return Twin(log, optimum, np.searchsorted(names, log.landmark), recording.landmark is not None, left_out)


def write_twin(folder: Path, twin: Twin, name: str) -> None:
    """Write the scenario and its three CSV files into an existing folder; `name` is the log's in the description.

    Raises:
        UserError: a file cannot be written.
    """
    log, optimum, model = twin.recording, twin.optimum, SENSORS[twin.recording.sensor]
    places = optimum.landmarks[np.argsort(optimum.landmark_ids)]
    distance = np.linalg.norm(places[twin.landmark] - optimum.poses[log.observation_step, :2], axis=1)
    sensor = {"kind": log.sensor, "max_range": float(math.ceil(distance.max() + 1e-9)), "sightings": TWIN_SIGHTINGS}
    covs = upper_triangles(log.observation_cov)
    variances = dict(zip(model.sigmas, np.diag(log.observation_cov[0]), strict=True))  # one for both axes of a position
    common = np.diag([variances[name] for name in model.sigmas])
    is_common = bool((log.observation_cov == common).all())
    if is_common:
        covs = covs[:, :0]
        for each, is_angle in zip(model.sigmas, model.is_angle, strict=True):
            sigma = math.sqrt(variances[each])
            sensor[f"sigma_{each}{'_deg' if is_angle else ''}"] = math.degrees(sigma) if is_angle else sigma
    sections = {
        "": {"description": f"Twin of {name}: path and map of its optimum"},
        "prior": {"mean": optimum.poses[0].tolist(), "covariance": log.prior_cov.tolist()},
        "trajectory": {"kind": "csv", "file": TWIN_PATH},
        "motion": {"covariances": TWIN_MOTION},
        "sensor": sensor,
        **({} if twin.has_ids else {"association": {"method": "jcbb"}}),
        "landmarks": {"positions": places.tolist()},
    }
    header = sightings_header(log.sensor, has_covs=not is_common)
    write_rows(folder / TWIN_PATH, PATH_HEADER, log.stamps, optimum.poses)
    write_rows(folder / TWIN_MOTION, COV_HEADER, np.arange(1, log.steps + 1), upper_triangles(log.odometry_cov))
    write_rows(folder / TWIN_SIGHTINGS, header, log.observation_step, twin.landmark, covs)
    write_toml(folder / TWIN, sections)


def _run(name: str, recording: Recording, association: Association | None = None) -> Estimate:
    return run_estimator(name, load(ask([name])[0], association), recording)[0]
