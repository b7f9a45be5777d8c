"""Run one estimator, with errors in one line and a checked estimate, or several on one recording with their optima.

A request whose results do not fit into memory is refused before any work begins.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from time import perf_counter
from typing import cast

import numpy as np

from slamgauge.arrays import Marks, distinct
from slamgauge.compare.estimators.loading import HostedEstimator, LoadedEstimator, entry_behind, load, without
from slamgauge.compare.estimators.registry import FILTERS, GRAPHS, OPTIMA, UNDER
from slamgauge.compare.estimators.requests import Asked, BuiltIn, UserCode
from slamgauge.compare.estimators.stored_trajectory import OwnPoses, StoredEstimate
from slamgauge.compare.estimators.user_errors import UserCodeError, reason_of
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.storage.progress import counted
from slamgauge.errors import CovarianceError, UserError, failure_text
from slamgauge.estimate import Estimate, Estimator, Kind
from slamgauge.memory import require_memory
from slamgauge.notices import tell_once
from slamgauge.recording import Recording

FARTHEST = 1e12  # m, rad: far outside any map, and squares of errors are still finite
ESTIMATE_BYTES = 165  # for an estimate and its score, per step (docs/limits.md)
SERIES_BYTES = 88  # for one run and one estimator, per step: 11 series


def own_poses_of(estimator: Estimator | None) -> OwnPoses | None:
    """Return the poses of a stored trajectory at its own stamps; None if they are at the steps, or for others."""
    inner = estimator.estimate if isinstance(estimator, LoadedEstimator) else estimator
    return inner.own if isinstance(inner, StoredEstimate) else None


def remarks_of(estimator: Estimator) -> list[str]:
    """Return what users should know about the last run of their code, for example replaced settings."""
    inner = estimator.estimate if isinstance(estimator, LoadedEstimator) else estimator
    return [*getattr(inner, "remarks", [])]


def tell_remarks(name: str, remarks: Iterable[str]) -> None:
    """Print remarks on user code, each once: values in them, after the first comma, may differ between runs."""
    for remark in remarks:
        tell_once(f"{name}: {remark}", topic=f"{name}: {remark.partition(',')[0]}")


def run_estimator(
    name: str, estimator: Estimator, recording: Recording, *, remarked: bool = True
) -> tuple[Estimate, float]:
    """Run an estimator; return its estimate and its computing time [s].

    Remarks on user code are printed if `remarked`. `UserError`, or of a kind of `user_errors`: the estimator raised an
    error, or its estimate does not fit the recording.
    """
    entry = entry_behind(estimator)
    is_built_in = entry is not None and entry.role != "user"
    start = perf_counter()
    try:
        estimate = cast("object", estimator(recording))
    except (Exception, SystemExit) as error:
        if is_built_in and not isinstance(error, UserError):
            raise
        reason = str(error) if is_built_in else reason_of(error)
        kind = type(error) if isinstance(error, UserCodeError | CovarianceError) else UserError
        raise kind(f"estimator {name}: {reason}") from error
    seconds = perf_counter() - start
    if remarked and not is_built_in:
        tell_remarks(name, remarks_of(estimator))
    inner = estimator.estimate if isinstance(estimator, LoadedEstimator) else estimator
    seconds = inner.seconds if isinstance(inner, HostedEstimator) and inner.seconds is not None else seconds
    if reason := _misfit(estimate, recording):
        raise UserError(f"estimator {name}: {reason}")
    return cast("Estimate", estimate), seconds


def _misfit(estimate: object, recording: Recording) -> str:
    """Return why something cannot be an estimate of a recording; empty if it can."""
    if not isinstance(estimate, Estimate):
        return f"returned a {type(estimate).__name__}; return a slamgauge.Estimate"
    count = len(estimate.poses)
    if count != recording.steps + 1:
        return f"returned {count} poses; return {recording.steps + 1}, one for the start and one for every step"
    far = np.abs(estimate.poses).max(axis=1) > FARTHEST
    if far.any():
        step = int(far.argmax())
        pose = ", ".join(f"{each:.3g}" for each in estimate.poses[step])
        return f"has diverged, its pose of step {step} is ({pose}); mend it and run again"
    count, observations = len(recording.observation), estimate.association
    if observations is not None and len(observations) != count:
        return f"association has {len(observations)} entries; return {count}, one for every observation"
    return ""


def try_out(asked: Asked, recording: Recording) -> None:
    """Run user code on the first two steps of a recording, so that a refusal is printed before any run."""
    if isinstance(asked, UserCode):
        estimator = load(replace(asked, strict=False), announced=False)
        run_estimator(asked.label, estimator, recording.first(min(2, recording.steps)), remarked=False)


@dataclass(frozen=True)
class SideBySide:
    """Results of several estimators on one recording, by name.

    `seconds` are computing times, which stored estimates lack, `failures` are reasons of missing estimates. `optima`
    are names by kind, `stand_ins` those with the associations of an estimator, used if the true ones are unknown.
    `remarks` are those on user code, for example replaced settings.
    """

    estimates: dict[str, Estimate] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)
    optima: dict[Kind, str] = field(default_factory=dict)
    stand_ins: list[str] = field(default_factory=list)
    remarks: dict[str, list[str]] = field(default_factory=dict)

    def run(self, name: str, estimator: Estimator, recording: Recording, *, is_optimum: bool = False) -> None:
        """Run an estimator, and store its estimate or the reason of its failure."""
        try:
            self.estimates[name], seconds = run_estimator(name, estimator, recording)
        except Exception as error:  # noqa: BLE001 a defect of one estimator does not cost the results of the others
            begin = "" if isinstance(error, UserError) else f"estimator {name}: "
            self.failures[name] = f"{begin}{failure_text(error)}"
            return
        self.remarks[name] = remarks_of(estimator)
        if not (isinstance(estimator, LoadedEstimator) and isinstance(estimator.estimate, StoredEstimate)):
            self.seconds[name] = seconds
        if is_optimum:
            self.optima[self.estimates[name].kind] = name


def run_side_by_side(
    estimators: Mapping[str, Estimator], recording: Recording, informed: Recording, misleading: Marks | None = None
) -> SideBySide:
    """Run estimators on the recording, and informed graphs (the optima and gtsam-batch) on the informed recording.

    Informed graphs do not use observations marked `misleading` (M,). If the informed recording has no ids, they run
    last, with the associations of the first other estimator that has any, as `causal@ekf` does; an optimum that is
    requested so is then the optimum of its kind.
    """
    entries = {name: entry_behind(estimator) for name, estimator in estimators.items()}
    graphs = {name: entry for name, entry in entries.items() if entry is not None and entry.takes_associations}
    told = {name: entry for name, entry in graphs.items() if entry.is_informed}
    has_ids = informed.landmark is not None
    ran = SideBySide()
    with counted(len(estimators), "estimator") as progress:
        for label in sorted(estimators, key=lambda name: name in told and not has_ids):
            progress.set_description(label, refresh=not progress.delay)
            estimator, is_optimum = estimators[label], label in told and told[label].role == "optimum"
            others = {name: each.association for name, each in ran.estimates.items() if name not in graphs}
            makers = [name for name, association in others.items() if association is not None]
            if label in told and has_ids:
                ran.run(label, without(estimator, informed, misleading), informed, is_optimum=is_optimum)
            elif label in told and makers:
                stand_in = replace(told[label], name=f"{label}{UNDER}{makers[0]}")
                graph: Callable[..., Estimate] = stand_in.load()
                under = partial(graph, association=others[makers[0]])
                if stand_in.name not in ran.estimates:
                    ran.run(stand_in.name, LoadedEstimator(stand_in, under), recording, is_optimum=is_optimum)
            else:  # an optimum without any associations fails, and the reason is stored
                ran.run(label, estimator, recording)
            progress.update()
    if not has_ids:
        for name, entry in graphs.items():
            kind = ran.estimates[name].kind if name in ran.estimates else None
            if kind is not None and entry.name.partition(UNDER)[0] == OPTIMA[kind]:
                ran.optima.setdefault(kind, name)
        ran.stand_ins.extend(ran.optima.values())
    return ran


def require_room_for_runs(runs: int, scenario: Scenario, estimators: int) -> None:
    """Refuse runs whose series do not fit into memory; the summary of a study loads all of them."""
    poses = len(scenario.trajectory.stamps(scenario.prior.mean))
    what = f"runs: to sum up {runs} of {poses - 1} steps and {estimators} estimators"
    needed = float(SERIES_BYTES) * runs * poses * (estimators + 1)  # the series of one estimator are loaded twice
    require_memory(needed, what, "give fewer runs, or a shorter trajectory.duration")


def require_room_for_estimates(recording: Recording, asked: Sequence[Asked]) -> None:
    """Refuse estimators whose estimates, filters whose covariance, or graphs whose matrices do not fit into memory."""
    what = f"estimators: {len(asked)} of {recording.steps} steps: what they estimate"
    needed = float(ESTIMATE_BYTES) * recording.steps * len(asked)
    require_memory(needed, what, "give fewer, or a shorter run")
    landmarks = 0 if recording.landmark is None else len(distinct(recording.landmark))
    for each in (each for each in asked if isinstance(each, BuiltIn)):
        if each.name in FILTERS:
            what = f"{each.label}: the covariance of {landmarks} landmarks"
            require_memory(8.0 * (3 + 2 * landmarks) ** 2, what, "give fewer landmarks, or leave it out")
        if landmarks and any(each.name.startswith(name) for name in GRAPHS) and UNDER not in each.name:
            from slamgauge.graph_baseline.problem.preparation import prepare  # slow libraries
            from slamgauge.graph_baseline.solver.smoother import require_memory_for

            require_memory_for(prepare(recording), each.name)
