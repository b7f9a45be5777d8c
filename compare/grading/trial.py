"""Work of one worker: reference and optimum of a run, or all runs and checks of a submission.

The truth stays in the worker; the submission runs in a child process.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.checks.examination import Verdict, check_estimator
from slamgauge.compare.estimators.causality_check import require_causal
from slamgauge.compare.estimators.isolated_process import Isolated
from slamgauge.compare.estimators.loading import load, without
from slamgauge.compare.estimators.registry import CAUSAL
from slamgauge.compare.estimators.requests import Asked, Isolation, ask
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.estimators.user_code import Address
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.simulation import simulate, simulate_informed
from slamgauge.compare.scoring.scores import Score, evaluate
from slamgauge.errors import UserError, failure_text
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS
from slamgauge.truth import Truth

REPLACED = (
    "Q of the file",
    "Py of the file",
    "Cx of the file",
)  # beginnings of remarks on noise that the recording's replaces
NO_IDS = "they need ranges and bearings with ids"


@dataclass(frozen=True)
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


def reference_run(scenario: Scenario, seed: int, reference: Asked) -> tuple[Score, Estimate | None]:
    """Return the score of the reference on a run, and the estimate of the causal optimum; None if it is undetermined.

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
    return _scored(truth, recording, estimate, optimum, seconds), optimum


def run_trial(
    where: Address,
    name: str,
    scenario: Scenario,
    seeds: Sequence[int],
    optima: Sequence[Estimate | None],
    isolation: Isolation,
) -> Trial:
    """Run a submission on all runs, then the checks if they apply to such recordings.

    Args:
        where: its file.
        name: its name in error messages.
        scenario: scenario of the runs.
        seeds: seeds of the runs.
        optima: estimates of the causal optimum on the same runs.
        isolation: largest time of a run, and whether it runs without a wall.
    """
    trial = Trial()
    with closing(Isolated(where, isolation.timeout, unconfined=isolation.unconfined)) as estimator:
        try:
            trial = replace(trial, form=estimator.begin() or "estimate(recording)", callable=estimator.where.attribute)
            for run, (seed, optimum) in enumerate(zip(seeds, optima, strict=True)):
                truth, recording = simulate(scenario, seed)
                estimate, seconds = run_estimator(name, estimator, recording)
                if run in (0, len(seeds) // 2, len(seeds) - 1):
                    require_causal(estimator, recording, estimate)
                if run == 0:
                    trial.settings.extend(estimator.remarks(recording))
                trial.scores.append(_scored(truth, recording, estimate, optimum, seconds))
            if any(each.startswith(REPLACED) for each in trial.settings):
                trial.own_noise.extend(_own_noise_scores(estimator.where, name, scenario, seeds, isolation))
            if not SENSORS[scenario.sensor.kind].has_range or scenario.association.method != "known":
                trial = replace(trial, no_checks=NO_IDS)
            else:
                trial = replace(trial, verdicts=check_estimator(name, estimator))
        except UserError as error:
            is_done = len(trial.scores) == len(seeds)
            which = "small recording of the checks: " if is_done else f"run {len(trial.scores)}: " if trial.form else ""
            text = str(error).removeprefix(f"estimator {name}: ").removeprefix(f"estimator {where.text}: ")
            trial = replace(trial, reason=f"{which}{text}")
        except Exception as error:  # noqa: BLE001 other submissions are graded, and the page shows this error
            trial = replace(trial, reason=failure_text(error))
        return replace(trial, output=estimator.last_output)


def _own_noise_scores(
    where: Address, name: str, scenario: Scenario, seeds: Sequence[int], isolation: Isolation
) -> list[Score]:
    """Return the scores with the noise of the file; without scores if it fails with that noise."""
    scores: list[Score] = []
    where = where._replace(noise="file")
    with closing(Isolated(where, isolation.timeout, unconfined=isolation.unconfined)) as estimator:
        for seed in seeds:
            truth, recording = simulate(scenario, seed)
            try:
                estimate, seconds = run_estimator(f"{name}, noise of the file", estimator, recording)
            except UserError:
                return []
            scores.append(_scored(truth, recording, estimate, None, seconds))
    return scores


def _scored(truth: Truth, recording: Recording, estimate: Estimate, optimum: Estimate | None, seconds: float) -> Score:
    """Score an estimate, a filtered one also relative to the causal optimum."""
    score = evaluate(truth, recording, estimate, optimum if estimate.kind == "filtered" else None)
    return replace(score, seconds_total=seconds)


def optimum_ates(scores: Sequence[Score]) -> Float:
    """Return the ATE (R,) [m] of the optimum that the scores are relative to; NaN where it is missing."""
    pairs = [(each.ate_m, each.ratio_to_optimum) for each in scores]
    return np.array([ate / ratio if ate and ratio else np.nan for ate, ratio in pairs])
