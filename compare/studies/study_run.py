"""One run of a study, as a worker executes it: simulate, estimate, score."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.loading import load, remarks_of, without
from slamgauge.compare.estimators.registry import entry_of
from slamgauge.compare.estimators.requests import Asked, BuiltIn, Chosen, ask
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.simulation import simulate_informed
from slamgauge.compare.scoring.catalogue import STORED, measured
from slamgauge.compare.scoring.consistency import squared_mahalanobis
from slamgauge.compare.scoring.landmark_identity import landmark_errors, true_landmarks
from slamgauge.compare.scoring.nan_stats import number, rms
from slamgauge.compare.scoring.ray_figures import RayFigures
from slamgauge.compare.scoring.runs import SERIES
from slamgauge.compare.scoring.scores import filter_figures, map_figures, pose_covs_of
from slamgauge.compare.scoring.trajectory_error import pose_errors
from slamgauge.compare.storage.safe_names import shown
from slamgauge.errors import failure_text, refused_by_the_machine
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth


@dataclass(frozen=True)
class Outcome:
    """Result of one estimator in one run: figures and series, or an error; remarks are lines on user code."""

    estimator: str
    kind: str = ""
    figures: dict[str, float | None] = field(default_factory=dict)
    series: bytes = b""  # (len(SERIES), N+1) in single precision
    error: str | None = None
    transient: bool = False  # a failure of the machine, not of the input: the same run may succeed later
    remarks: tuple[str, ...] = ()


def run_seed(seed: int, run: int) -> int:
    """Return the seed of run number `run`: independent streams, the same for any number of runs."""
    return int(np.random.SeedSequence(seed, spawn_key=(run,)).generate_state(1, np.uint64)[0] >> np.uint64(1))


def run_once(scenario: Scenario, seed: int, estimators: Chosen) -> list[Outcome]:
    """Simulate one run and score estimators on it; the outcome of one that fails has its error.

    The optima receive the measurements with their true noise and associations (`simulation.informed`).
    """
    asked = ask(estimators)
    try:
        truth, recording, exact = simulate_informed(scenario, seed)
    except Exception as error:  # noqa: BLE001 the study continues and reports the error
        failed = _failed("", error)
        return [replace(failed, estimator=each.key, error=f"simulation: {failed.error}") for each in asked]
    return [_outcome(scenario, each, truth, exact if each.is_told else recording) for each in asked]


def _outcome(scenario: Scenario, asked: Asked, truth: Truth, recording: Recording) -> Outcome:
    remarks: tuple[str, ...] = ()
    try:
        if isinstance(asked, BuiltIn) and asked.is_bound:
            return _bound(asked, truth, recording)
        estimator = load(
            asked, scenario.association, scenario.initialisation_settings, robust=scenario.robustness, announced=False
        )
        remarks = (estimator.form,) if estimator.form else ()
        if asked.is_told:
            estimator = without(estimator, recording, truth.misleading)
        estimate, seconds = run_estimator(asked.label, estimator, recording, remarked=False)
        remarks = (*remarks, *remarks_of(estimator))
        series = step_series(truth, estimate)
        distances = np.hypot(series[0], series[1])  # equal to the last bit to stores of earlier versions
        figures = map_figures(truth, recording, estimate, None) | filter_figures(estimate)
        figures |= near_and_far(truth, recording, estimate) | measured(truth, recording, estimate, in_study=True)
        figures |= {"ate_m": rms(distances), "final_position_error_m": number(distances[-1])}
        figures["observations"] = len(recording.observation)
        if estimate.seconds is None:
            figures["seconds_total"] = seconds
        rays = figures["rays"]
        figures |= {f"rays_{name}": None if rays is None else getattr(rays, name) for name in RayFigures._fields}
        stored = {key: figures[key] for key in STORED}
        return Outcome(asked.key, estimate.kind, stored, series.astype(np.float32).tobytes(), remarks=remarks)
    except Exception as error:  # noqa: BLE001 the study continues and reports the error
        return replace(_failed(asked.key, error), remarks=remarks)


def _bound(asked: BuiltIn, truth: Truth, recording: Recording) -> Outcome:
    """Return the outcome of an estimator whose errors are the standard deviations of the bound."""
    entry = entry_of(asked.name)
    begun = perf_counter()
    covs = entry.bounds(truth, recording)
    figures = dict.fromkeys(STORED) | {
        "observations": len(recording.observation),
        "seconds_total": perf_counter() - begun,
    }
    sigmas = np.sqrt(np.diagonal(covs, axis1=1, axis2=2).clip(min=0)).T
    series = np.concatenate([sigmas, sigmas, np.full((len(SERIES) - 6, len(covs)), np.nan)])
    return Outcome(asked.key, str(entry.kind), figures, series.astype(np.float32).tobytes())


def _failed(name: str, error: Exception) -> Outcome:
    return Outcome(name, error=shown(failure_text(error)), transient=refused_by_the_machine(error))


def near_and_far(truth: Truth, recording: Recording, estimate: Estimate) -> dict[str, float | None]:
    """Return RMS error and RMS sigma [m] of the half of the mapped landmarks near the start, and of the far half."""
    assert truth.poses is not None
    ids, landmarks = true_landmarks(truth, recording, estimate)
    errors = np.linalg.norm(landmark_errors(ids, landmarks, truth.landmark_ids, truth.landmarks), axis=1)
    covs = estimate.landmark_covs
    sigmas = np.full(len(ids), np.nan) if covs is None else np.sqrt(np.trace(covs, axis1=1, axis2=2).clip(min=0))
    offsets = landmark_errors(ids, np.tile(truth.poses[0, :2], (len(ids), 1)), truth.landmark_ids, truth.landmarks)
    distances = np.linalg.norm(offsets, axis=1)
    known = ~np.isnan(distances)
    near = distances <= np.median(distances[known]) if known.any() else known
    far = ~near & known
    return {
        "landmark_sigma_near_m": rms(sigmas[near]),
        "landmark_sigma_far_m": rms(sigmas[far]),
        "landmark_error_near_m": rms(errors[near]),
        "landmark_error_far_m": rms(errors[far]),
    }


def step_series(truth: Truth, estimate: Estimate) -> Float:
    """Return the rows of `SERIES` (11, N+1); NaN where a figure is undefined."""
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
