"""Work of one worker: reference and optimum of a run, or all runs and checks of a submission.

The truth stays in the worker; the submission runs in a child process.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.checks.check import Check
from slamgauge.compare.checks.examination import Verdict, check_estimator
from slamgauge.compare.estimators.child import Host
from slamgauge.compare.estimators.forms.signatures import shortened
from slamgauge.compare.estimators.loading import HostedEstimator, load, require_causal, without
from slamgauge.compare.estimators.registry import CAUSAL
from slamgauge.compare.estimators.requests import Address, Asked, Limits, ask
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.simulation import simulate, simulate_informed
from slamgauge.compare.scoring.scores import Score, evaluate
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS
from slamgauge.truth import Truth

NO_IDS = "they need ranges and bearings with ids"


@dataclass
class Trial:
    """Runs and checks of a submission.

    Attributes:
        callable: name of the callable that was found in its file.
        form: description of its form.
        scores: scores of its runs in their order, as far as they succeeded.
        settings: remarks of its form on its first run, for example settings of the file that are replaced.
        own_noise: scores of the same runs with the noise of the file, if it has another one that can be set.
        verdicts: results of the checks, if they apply.
        no_checks: why the checks do not apply.
        output: its last lines of output.
        reason: why it cannot be graded.
    """

    callable: str = ""
    form: str = ""
    scores: list[Score] = field(default_factory=list)
    settings: list[str] = field(default_factory=list)
    own_noise: list[Score] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    no_checks: str = ""
    output: str = ""
    reason: str | None = None


class Run(NamedTuple):
    """A run of the reference.

    Attributes:
        seed: seed of the simulation.
        score: score of the reference.
        optimum: estimate of the causal optimum; None if it is undetermined.
    """

    seed: int
    score: Score
    optimum: Estimate | None


def reference_run(scenario: Scenario, seed: int, reference: Asked) -> Run:
    """Run the reference and the causal optimum.

    Raises:
        UserError: the reference fails.
    """
    truth, recording, informed = simulate_informed(scenario, seed)
    estimator = load(
        reference, scenario.association, scenario.initialisation_settings, robust=scenario.robustness, announced=False
    )
    estimate, seconds = run_estimator(reference.label, estimator, recording)
    try:
        (best,) = ask([CAUSAL])
        optimum = run_estimator(CAUSAL, without(load(best), informed, truth.misleading), informed)[0]
    except UserError:  # the recording does not determine it
        optimum = None
    return Run(seed, _scored(truth, recording, estimate, optimum, seconds), optimum)


def run_trial(
    where: Address, name: str, scenario: Scenario, runs: Sequence[Run], limits: Limits, checks: Sequence[Check]
) -> Trial:
    """Run a submission on all runs, then the checks if they apply to such recordings.

    Runs, the shorter recordings of the causality check, and checks have a process each.

    Args:
        where: its file.
        name: its name in error messages.
        scenario: scenario of the runs.
        runs: the same runs of the reference.
        limits: largest time of a run, and whether it runs behind a wall.
        checks: checks that it is judged by.
    """
    trial = Trial()
    with ExitStack() as open_ones:
        host, prefixes, checked = (open_ones.enter_context(closing(Host(where, limits))) for _ in range(3))
        try:
            trial.form = host.begin() or "estimate(recording)"
            trial.callable = host.where.attribute
            _run_all(trial, host, prefixes, name, scenario, runs)
            if not SENSORS[scenario.sensor.kind].has_range or scenario.association.method != "known":
                trial.no_checks = NO_IDS
            else:
                trial.verdicts = check_estimator(name, HostedEstimator(checked), checks=checks)
        except UserError as error:
            is_done = len(trial.scores) == len(runs)
            which = "small recording of the checks: " if is_done else f"run {len(trial.scores)}: " if trial.form else ""
            text = shortened(error).removeprefix(f"estimator {name}: ").removeprefix(f"estimator {where.text}: ")
            trial.reason = f"{which}{text}"
        trial.output = host.last_output
    return trial


def _run_all(trial: Trial, host: Host, prefixes: Host, name: str, scenario: Scenario, runs: Sequence[Run]) -> None:
    """Add the scores of all runs to a trial; the first, the middle and the last one are checked for causality."""
    estimator, has_own_noise = HostedEstimator(host), False
    for number, run in enumerate(runs):
        truth, recording = simulate(scenario, run.seed)
        estimate, seconds = run_estimator(name, estimator, recording, remarked=False)
        if number == 0:
            trial.settings, has_own_noise = [*estimator.remarks], estimator.replaces_noise
        if number in (0, len(runs) // 2, len(runs) - 1):
            require_causal(prefixes, recording, estimate)
        trial.scores.append(_scored(truth, recording, estimate, run.optimum, seconds))
    if has_own_noise:
        trial.own_noise = _own_noise_scores(host, name, scenario, runs)


def _own_noise_scores(host: Host, name: str, scenario: Scenario, runs: Sequence[Run]) -> list[Score]:
    """Return the scores with the noise of the file; without scores if it fails with that noise."""
    scores: list[Score] = []
    estimator = HostedEstimator(host, noise="file")
    for run in runs:
        truth, recording = simulate(scenario, run.seed)
        try:
            estimate, seconds = run_estimator(f"{name}, noise of the file", estimator, recording, remarked=False)
        except UserError:
            return []
        scores.append(_scored(truth, recording, estimate, None, seconds))
    return scores


def _scored(truth: Truth, recording: Recording, estimate: Estimate, optimum: Estimate | None, seconds: float) -> Score:
    """Score an estimate, a filtered one also relative to the causal optimum."""
    score = evaluate(truth, recording, estimate, optimum if estimate.kind == "filtered" else None)
    return score.timed(seconds if math.isfinite(seconds) else None)


def optimum_ates(scores: Sequence[Score]) -> Float:
    """Return the ATE (R,) [m] of the optimum that the scores are relative to; NaN where it is missing."""
    pairs = [(each["ate_m"], each["ratio_to_optimum"]) for each in scores]
    return np.array([ate / ratio if ate and ratio else np.nan for ate, ratio in pairs])
