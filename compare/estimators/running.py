"""Run one estimator, with errors in one line and a checked estimate, or several on one recording with their optima."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from time import perf_counter
from typing import cast

import numpy as np

from slamgauge.arrays import Marks
from slamgauge.compare.estimators.loading import LoadedEstimator, entry_behind, load, remarks_of, seconds_of, without
from slamgauge.compare.estimators.registry import OPTIMA, UNDER, Entry
from slamgauge.compare.estimators.requests import Asked, UserCode
from slamgauge.compare.estimators.stored_trajectory import OwnPoses, StoredEstimate
from slamgauge.compare.estimators.user_errors import UserCodeError, reason_of
from slamgauge.compare.storage.progress import counted
from slamgauge.errors import CovarianceError, UserError, failure_text
from slamgauge.estimate import Estimate, Estimator, Kind
from slamgauge.notices import tell_first
from slamgauge.recording import Recording

FARTHEST = 1e12  # m, rad: far outside any map, and squares of errors are still finite


def own_poses_of(estimator: Estimator | None) -> OwnPoses | None:
    """Return the poses of a stored trajectory at its own stamps; None if they are at the steps, or for others."""
    inner = estimator.estimate if isinstance(estimator, LoadedEstimator) else estimator
    return inner.own if isinstance(inner, StoredEstimate) else None


def run_estimator(
    name: str, estimator: Estimator, recording: Recording, *, remarked: bool = True
) -> tuple[Estimate, float]:
    """Run an estimator; return its estimate and the elapsed time [s].

    Remarks on user code are printed if `remarked`.

    Raises:
        UserError: the estimator raised an error, or its estimate does not fit the recording.
        OverdueError, CovarianceError: of these kinds, if its reason is that.
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
    if remarked and not is_built_in:
        tell_remarks(name, remarks_of(estimator))
    seconds = perf_counter() - start
    own_seconds = seconds_of(estimator)
    return _checked(name, estimate, recording), seconds if own_seconds is None else own_seconds


def tell_remarks(name: str, remarks: Iterable[str]) -> None:
    """Print remarks on user code, each once: values in them, after the first comma, may differ between runs."""
    for remark in remarks:
        tell_first(f"{name}: {remark.partition(',')[0]}", f"{name}: {remark}")


def try_out(asked: Asked, recording: Recording) -> None:
    """Run user code on the first two steps of a recording, so that a refusal is printed before any run.

    Raises:
        UserError: the code cannot be loaded, has none of the forms, or fails.
    """
    if isinstance(asked, UserCode):
        estimator = load(replace(asked, strict=False), announced=False)
        run_estimator(asked.label, estimator, recording.first(min(2, recording.steps)), remarked=False)


def _checked(name: str, estimate: object, recording: Recording) -> Estimate:
    if not isinstance(estimate, Estimate):
        raise UserError(f"estimator {name}: returned a {type(estimate).__name__}; return a slamgauge.Estimate")
    if len(estimate.poses) != recording.steps + 1:
        raise UserError(
            f"estimator {name}: returned {len(estimate.poses)} poses; "
            f"return {recording.steps + 1}, one for the start and one for every step"
        )
    far = np.abs(estimate.poses).max(axis=1) > FARTHEST
    if far.any():
        step = int(far.argmax())
        pose = ", ".join(f"{each:.3g}" for each in estimate.poses[step])
        raise UserError(f"estimator {name}: has diverged, its pose of step {step} is ({pose}); mend it and run again")
    if estimate.association is not None and len(estimate.association) != len(recording.observation):
        raise UserError(
            f"estimator {name}: association has {len(estimate.association)} entries; "
            f"return {len(recording.observation)}, one for every observation"
        )
    return estimate


@dataclass(frozen=True)
class SideBySide:
    """Results of several estimators on one recording.

    Attributes:
        estimates: by name.
        seconds: computing times [s] by name; stored estimates have none.
        failures: reasons of missing estimates, by name.
        optima: name of the optimum of each kind of estimate.
        stand_ins: optima with the associations of an estimator, used if the true ones are unknown.
        remarks: remarks on user code, for example replaced settings, by name.
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
        except UserError as error:
            self.failures[name] = str(error)
            return
        except Exception as error:  # noqa: BLE001 a defect of one estimator does not cost the results of the others
            self.failures[name] = f"estimator {name}: {failure_text(error)}"
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

    Informed graphs do not use observations marked `misleading` (M,). If the informed recording has no ids, they use the
    associations of the first other estimator, as in `causal@ekf`.
    """
    entries = {name: entry_behind(estimator) for name, estimator in estimators.items()}
    told = {name: entry for name, entry in entries.items() if entry is not None and entry.is_informed}
    waiting = told if informed.landmark is None else {}
    ran = SideBySide()
    with counted(len(estimators), "estimator") as progress:
        for name, estimator in estimators.items():
            progress.set_description(name, refresh=not progress.delay)
            if name in told and name not in waiting:
                is_optimum = told[name].role == "optimum"
                ran.run(name, without(estimator, informed, misleading), informed, is_optimum=is_optimum)
            elif name not in waiting:
                ran.run(name, estimator, recording)
            progress.update()
    if informed.landmark is None:
        graphs = {name: entry for name, entry in entries.items() if entry is not None and entry.takes_associations}
        _run_stand_ins(ran, waiting, graphs, estimators, recording)
    return ran


def _run_stand_ins(
    ran: SideBySide,
    waiting: Mapping[str, Entry],
    graphs: Mapping[str, Entry],
    estimators: Mapping[str, Estimator],
    recording: Recording,
) -> None:
    """Run graphs with the associations of the first estimator that has any; a requested `causal@ekf` is an optimum."""
    makers = (name for name, each in ran.estimates.items() if name not in graphs and each.association is not None)
    maker = next(makers, None)
    for name, entry in waiting.items():
        if maker is None:
            ran.run(name, estimators[name], recording)  # this stores the reason of its failure
        elif f"{name}{UNDER}{maker}" not in ran.estimates:
            stand_in = replace(entry, name=f"{name}{UNDER}{maker}")
            graph: Callable[..., Estimate] = entry.load()
            under = partial(graph, association=ran.estimates[maker].association)
            is_optimum = entry.role == "optimum"
            ran.run(stand_in.name, LoadedEstimator(stand_in, under), recording, is_optimum=is_optimum)
    for name, entry in graphs.items():
        kind = ran.estimates[name].kind if name in ran.estimates else None
        if kind is not None and entry.name.partition(UNDER)[0] == OPTIMA[kind]:
            ran.optima.setdefault(kind, name)
    ran.stand_ins.extend(ran.optima.values())
