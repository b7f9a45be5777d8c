"""Work of one worker: reference and optimum of a run, or all runs and checks of a submission.

The truth stays in the worker; the submission runs in a child process.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.checks.examination import Verdict, check_estimator
from slamgauge.compare.estimators.child import Host
from slamgauge.compare.estimators.forms.signatures import shortened
from slamgauge.compare.estimators.loading import HostedEstimator, load, require_causal, without
from slamgauge.compare.estimators.registry import CAUSAL
from slamgauge.compare.estimators.requests import Address, Asked, Limits, ask
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.grading.rubric import Rubric
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
    """Runs and checks of a submission."""

    callable: str = ""  # name of the callable that was found in its file
    form: str = ""  # description of its form
    scores: list[Score] = field(default_factory=list)  # scores of its runs, as far as they succeeded
    settings: list[str] = field(default_factory=list)  # remarks of its form, for example settings that are replaced
    own_noise: list[Score] = field(default_factory=list)  # the same runs with the noise of the file, if it differs
    verdicts: list[Verdict] = field(default_factory=list)  # results of the checks, if they apply
    no_checks: str = ""  # why the checks do not apply
    output: str = ""  # its last printed lines
    reason: str | None = None  # why it cannot be graded

    @property
    def failed_checks(self) -> list[str]:
        """Names of the failed checks."""
        return [verdict.name for verdict in self.verdicts if verdict.is_failure]


class Run(NamedTuple):
    """A run of the reference."""

    seed: int  # seed of the simulation
    score: Score  # score of the reference
    optimum: Estimate | None  # causal optimum; None if it is undetermined


@dataclass(frozen=True)
class GradeSettings:
    """Settings of grading."""

    scenario: Scenario  # scenario of the simulated runs
    runs: int  # number of runs, at least 2
    seed: int  # root seed, not negative
    reference: Asked  # estimator whose results submissions are compared with
    limits: Limits  # largest time of a run of a submission, and whether it runs behind a wall
    rubric: Rubric  # weights of the points


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


def run_trial(where: Address, name: str, settings: GradeSettings, runs: Sequence[Run]) -> Trial:
    """Run the submission `name` at `where` on all runs, then the checks if they apply to such recordings.

    Runs, the shorter recordings of the causality check, and checks have a process each; `runs` are the same runs of the
    reference.
    """
    trial, scenario = Trial(), settings.scenario
    with ExitStack() as open_ones:
        host, prefixes, checked = (open_ones.enter_context(closing(Host(where, settings.limits))) for _ in range(3))
        try:
            trial.form = host.begin() or "estimate(recording)"
            trial.callable = host.where.attribute
            _run_all(trial, host, prefixes, name, scenario, runs)
            if not SENSORS[scenario.sensor.kind].has_range or scenario.association.method != "known":
                trial.no_checks = NO_IDS
            else:
                estimator = HostedEstimator(checked)
                trial.verdicts = check_estimator(name, estimator, checks=settings.rubric.needed_checks)
        except UserError as error:
            is_done = len(trial.scores) == len(runs)
            which = "small recording of the checks: " if is_done else f"run {len(trial.scores)}: " if trial.form else ""
            text = shortened(error).removeprefix(f"estimator {name}: ").removeprefix(f"estimator {where.text}: ")
            trial.reason = f"{which}{text}"
        trial.output = host.last_output
    return trial


def _run_all(trial: Trial, host: Host, prefixes: Host, name: str, scenario: Scenario, runs: Sequence[Run]) -> None:
    """Add the scores of all runs to a trial; the first, the middle and the last one are checked for causality.

    If the file has other noise, the runs are repeated with it; these scores are left out if it fails with that noise.
    """
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
        with suppress(UserError):
            trial.own_noise = [_own_noise_score(host, name, scenario, run) for run in runs]


def _own_noise_score(host: Host, name: str, scenario: Scenario, run: Run) -> Score:
    truth, recording = simulate(scenario, run.seed)
    estimator = HostedEstimator(host, noise="file")
    estimate, seconds = run_estimator(f"{name}, noise of the file", estimator, recording, remarked=False)
    return _scored(truth, recording, estimate, None, seconds)


def _scored(truth: Truth, recording: Recording, estimate: Estimate, optimum: Estimate | None, seconds: float) -> Score:
    """Score an estimate, a filtered one also relative to the causal optimum."""
    score = evaluate(truth, recording, estimate, optimum if estimate.kind == "filtered" else None)
    return score.timed(seconds if math.isfinite(seconds) else None)


def optimum_ates(scores: Sequence[Score]) -> Float:
    """Return the ATE (R,) [m] of the optimum that the scores are relative to; NaN where it is missing."""
    pairs = [(each["ate_m"], each["ratio_to_optimum"]) for each in scores]
    return np.array([ate / ratio if ate and ratio else np.nan for ate, ratio in pairs])
