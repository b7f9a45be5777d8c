"""One run of a study, as a worker executes it: simulate, estimate, score."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.loading import load, without
from slamgauge.compare.estimators.registry import entry_of
from slamgauge.compare.estimators.requests import Asked, BuiltIn, Chosen, ask
from slamgauge.compare.estimators.running import remarks_of, run_estimator
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.simulation import simulate_informed
from slamgauge.compare.scoring.catalogue import Measured, measured
from slamgauge.compare.scoring.consistency import squared_mahalanobis
from slamgauge.compare.scoring.runs import SERIES
from slamgauge.compare.storage.result_files import shown
from slamgauge.errors import UserError, failure_text, refused_by_the_machine
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


def require_numbers(runs: int, seed: int) -> None:
    """Raise a `UserError` if a number of runs or a root seed is too small."""
    if runs < 1:
        raise UserError(f"runs: {runs} is too few; give at least 1")
    if seed < 0:
        raise UserError(f"seed: {seed} is negative; use a whole number >= 0")


def run_seed(seed: int, run: int) -> int:
    """Return the seed of run number `run`: independent streams, the same for any number of runs."""
    spawned = np.random.SeedSequence(seed, spawn_key=(run,))
    return int(spawned.generate_state(1, np.uint64)[0]) >> 1


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
        found = Measured(truth, recording, estimate)
        figures = measured(found, in_study=True)
        if estimate.seconds is None:
            figures["seconds_total"] = seconds
        return Outcome(asked.key, estimate.kind, figures, _bytes(step_series(found)), remarks=remarks)
    except Exception as error:  # noqa: BLE001 the study continues and reports the error
        return replace(_failed(asked.key, error), remarks=remarks)


def _bound(asked: BuiltIn, truth: Truth, recording: Recording) -> Outcome:
    """Return the outcome of an estimator whose errors are the standard deviations of the bound."""
    entry = entry_of(asked.name)
    begun = perf_counter()
    covs = entry.bounds(truth, recording)
    seconds = perf_counter() - begun
    sigmas = np.sqrt(np.diagonal(covs, axis1=1, axis2=2).clip(min=0)).T
    unknown = np.full((len(SERIES) - 6, len(covs)), np.nan)
    series = np.concatenate([sigmas, sigmas, unknown])
    return Outcome(asked.key, str(entry.kind), {"seconds_total": seconds}, _bytes(series))


def _failed(name: str, error: Exception) -> Outcome:
    return Outcome(name, error=shown(failure_text(error)), transient=refused_by_the_machine(error))


def _bytes(series: Float) -> bytes:
    return series.astype(np.float32).tobytes()


def step_series(found: Measured) -> Float:
    """Return the rows of `SERIES` (11, N+1); NaN where a figure is undefined."""
    estimate, undefined = found.estimate, np.full(len(found.errors), np.nan)
    rows = [
        *found.errors.T,
        *found.sigmas.T,
        found.nees,
        found.nees_xy,
        squared_mahalanobis(found.errors[:, 2:], found.covs[:, 2:, 2:]),
        undefined if estimate.nis is None else estimate.nis,
        undefined if estimate.nis_dof is None else estimate.nis_dof,
    ]
    return np.array(rows, dtype=np.float64)
