"""One run of a study, as a worker carries it out: simulate, estimate, score."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from compare.consistency import squared_mahalanobis
from compare.defined import number, rms
from compare.estimators import load_estimators, run_estimator
from compare.scenario import Scenario
from compare.scores import filter_figures, map_figures, pose_covs_of
from compare.simulation import simulate
from compare.trajectory_error import pose_errors
from slam2d import Estimate, Estimator, Float, Recording, Truth

# what is kept of every step: errors and sigmas [m, m, rad], NEES, and the NIS with its degrees of freedom
SERIES = (
    "error_x",
    "error_y",
    "error_heading",
    "sigma_x",
    "sigma_y",
    "sigma_heading",
    "nees_pose",
    "nees_position",
    "nees_heading",
    "nis",
    "nis_dof",
)
FIGURES = (
    "ate_m",
    "final_position_error_m",
    "nis_total",
    "nis_dof_total",
    "landmark_rmse_m",
    "landmark_nees_per_dof",
    "landmarks_mapped",
    "wrong_associations",
    "seconds_total",
)


@dataclass(frozen=True)
class Outcome:
    """What one estimator made of one run: its figures and series, or the error that it ended with."""

    estimator: str
    kind: str = ""
    figures: dict[str, float | None] = field(default_factory=dict)
    series: bytes = b""  # (len(SERIES), N+1) in single precision
    error: str | None = None


def run_seed(seed: int, run: int) -> int:
    """The seed of run number `run` of a study: independent streams, whatever the number of runs."""
    return int(np.random.SeedSequence(seed, spawn_key=(run,)).generate_state(1, np.uint64)[0] >> np.uint64(1))


def run_once(scenario: Scenario, seed: int, names: Sequence[str]) -> list[Outcome]:
    """Simulate one run and score the estimators `names` on it; an estimator that fails leaves its error."""
    try:
        truth, recording = simulate(scenario, seed)
    except Exception as error:  # noqa: BLE001 the study goes on, and shows what happened
        return [Outcome(name, error=f"simulation: {type(error).__name__}: {error}") for name in names]
    return [_outcome(name, estimator, truth, recording) for name, estimator in load_estimators(names).items()]


def _outcome(name: str, estimator: Estimator, truth: Truth, recording: Recording) -> Outcome:
    try:
        estimate, seconds = run_estimator(name, estimator, recording)
        series = step_series(truth, estimate)
        distances = np.hypot(series[0], series[1])
        known = map_figures(truth, recording, estimate, None) | filter_figures(estimate)
        known |= {"ate_m": rms(distances), "final_position_error_m": number(distances[-1])}
        if estimate.seconds is None:
            known["seconds_total"] = seconds
        figures = {key: known[key] for key in FIGURES}
        return Outcome(name, estimate.kind, figures, series.astype(np.float32).tobytes())
    except Exception as error:  # noqa: BLE001 the study goes on, and shows what happened
        return Outcome(name, error=f"{type(error).__name__}: {error}")


def step_series(truth: Truth, estimate: Estimate) -> Float:
    """The rows of `SERIES` (11, N+1); NaN where a figure is undefined."""
    assert truth.poses is not None
    errors = pose_errors(truth.poses, estimate.poses)
    undefined = np.full(len(errors), np.nan)
    covs = pose_covs_of(estimate)
    rows = [
        *errors.T,
        *np.sqrt(np.diagonal(covs, axis1=1, axis2=2).clip(min=0)).T,
        squared_mahalanobis(errors, covs),
        squared_mahalanobis(errors[:, :2], covs[:, :2, :2]),
        squared_mahalanobis(errors[:, 2:], covs[:, 2:, 2:]),
        undefined if estimate.nis is None else estimate.nis,
        undefined if estimate.nis_dof is None else estimate.nis_dof,
    ]
    return np.array(rows, dtype=np.float64)
