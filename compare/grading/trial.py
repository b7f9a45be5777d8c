"""What a worker does: the references of a run, and all runs and laws of a submission.

The truth is made here and stays here: a submission runs in a process of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.checks.examination import Verdict, check_estimator
from slamgauge.compare.estimators.causality_check import require_causal
from slamgauge.compare.estimators.isolated_process import Isolated
from slamgauge.compare.estimators.loading import load, without
from slamgauge.compare.estimators.registry import CAUSAL
from slamgauge.compare.estimators.requests import Asked, ask
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

FEW_STEPS, LOUDER = 20, 4.0  # of a recording whose noise is said to be that many times as large in variance


@dataclass(frozen=True)
class ReferenceRun:
    """What a run is measured by.

    Attributes:
        reference: the reference's score.
        optimum: the causal optimum's estimate; None where there is none.
    """

    reference: Score
    optimum: Estimate | None


@dataclass(frozen=True)
class Trial:
    """What a submission did.

    Attributes:
        callable: the name that was found in its file.
        form: in words.
        scores: of its runs, in their order; not all of them if there is a reason.
        verdicts: of the laws, where they apply.
        no_laws: why they do not.
        said: what it printed last.
        reason: why it cannot be graded.
    """

    callable: str = ""
    form: str = ""
    scores: list[Score] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    no_laws: str = ""
    said: str = ""
    reason: str | None = None


def reference_run(scenario: Scenario, seed: int, reference: Asked) -> ReferenceRun:
    """The reference and the causal optimum on one run.

    Raises:
        UserError: the reference gives no estimate.
    """
    truth, recording, told = simulate_informed(scenario, seed)
    estimator = load(
        reference, scenario.association, scenario.initialisation_settings, robust=scenario.robustness, announced=False
    )
    estimate, seconds = run_estimator(reference.label, estimator, recording)
    try:
        (best,) = ask([CAUSAL])
        optimum = run_estimator(CAUSAL, without(load(best), told, truth.misleading), told)[0]
    except UserError:  # not every recording determines one
        optimum = None
    return ReferenceRun(_scored(truth, recording, estimate, optimum, seconds), optimum)


def examine(
    where: Address,
    name: str,
    scenario: Scenario,
    seeds: Sequence[int],
    optima: Sequence[Estimate | None],
    timeout: float,
) -> Trial:
    """Run a submission on all runs, and hold it to the laws if they are about recordings like these.

    Args:
        where: its file.
        name: what error texts call it.
        scenario: what is simulated.
        seeds: of the runs.
        optima: the causal optimum's estimates of the same runs.
        timeout: of a run [s].
    """
    trial = Trial()
    with Isolated(where, timeout) as estimator:
        try:
            trial = replace(trial, form=estimator.begin() or "estimate(recording)", callable=estimator.where.attribute)
            for run, (seed, optimum) in enumerate(zip(seeds, optima, strict=True)):
                is_looked_at = run in (0, len(seeds) // 2, len(seeds) - 1)
                trial.scores.append(_score(estimator, name, scenario, seed, optimum, is_looked_at=is_looked_at))
            no_laws = _why_no_laws(estimator, name, scenario, seeds[0])
            verdicts = [] if no_laws else check_estimator(name, estimator)
            trial = replace(trial, verdicts=verdicts, no_laws=no_laws)
        except UserError as error:
            is_in_a_run = trial.form and len(trial.scores) < len(seeds)
            which = f"run {len(trial.scores)}: " if is_in_a_run else ""
            said = str(error).removeprefix(f"estimator {name}: ").removeprefix(f"estimator {where.text}: ")
            trial = replace(trial, reason=f"{which}{said}")
        except Exception as error:  # noqa: BLE001 the others are graded, and this is shown
            trial = replace(trial, reason=failure_text(error))
        return replace(trial, said=estimator.last_words)


def _score(
    estimator: Isolated, name: str, scenario: Scenario, seed: int, optimum: Estimate | None, *, is_looked_at: bool
) -> Score:
    """The score of one run."""
    truth, recording = simulate(scenario, seed)
    estimate, seconds = run_estimator(name, estimator, recording)
    if is_looked_at:
        require_causal(estimator, recording, estimate)
    return _scored(truth, recording, estimate, optimum, seconds)


def _why_no_laws(estimator: Isolated, name: str, scenario: Scenario, seed: int) -> str:
    """Why the laws cannot judge it; nothing if they can."""
    if not SENSORS[scenario.sensor.kind].has_range or scenario.association.method != "known":
        return "they are about ranges and bearings with ids"
    begin = simulate(scenario, seed)[1].first(FEW_STEPS)
    loud = replace(begin, odometry_cov=LOUDER * begin.odometry_cov, observation_cov=LOUDER * begin.observation_cov)
    one, other = (run_estimator(name, estimator, each)[0] for each in (begin, loud))
    if np.array_equal(one.poses, other.poses) and _same_covs(one, other):
        return "its noise is its own, whatever the recording says, and they go through all kinds of noise"
    return ""


def _same_covs(one: Estimate, other: Estimate) -> bool:
    """Whether both report the same covariances, or none."""
    if one.pose_covs is None or other.pose_covs is None:
        return one.pose_covs is other.pose_covs
    return np.array_equal(one.pose_covs, other.pose_covs)


def _scored(truth: Truth, recording: Recording, estimate: Estimate, optimum: Estimate | None, seconds: float) -> Score:
    """The score, that of a filtered estimate against the causal optimum."""
    score = evaluate(truth, recording, estimate, optimum if estimate.kind == "filtered" else None)
    return replace(score, seconds_total=seconds)


def optimum_ates(scores: Sequence[Score]) -> Float:
    """(R,) ATE [m] of the optimum that scores are relative to, NaN where there is none."""
    pairs = [(each.ate_m, each.ratio_to_optimum) for each in scores]
    return np.array([ate / ratio if ate and ratio else np.nan for ate, ratio in pairs])
