"""Estimators run on one recording: what has become of each, and which of them are the optima of which kind."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

from slamgauge.arrays import Marks
from slamgauge.compare.estimators.loading import LoadedEstimator, entry_behind, without
from slamgauge.compare.estimators.registry import OPTIMA, UNDER, Entry
from slamgauge.compare.estimators.running import StoredEstimate, run_estimator
from slamgauge.compare.storage.progress import counted
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator, Kind
from slamgauge.recording import Recording


@dataclass(frozen=True)
class SideBySide:
    """Estimates and computing times [s] by name, the reasons of those without, and who is the optimum of which kind.

    Nobody knows the times of stored ones.
    `stand_ins` are optima under somebody's associations, where nobody knows the true ones.
    """

    estimates: dict[str, Estimate] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)
    optima: dict[Kind, str] = field(default_factory=dict)
    stand_ins: list[str] = field(default_factory=list)

    def run(self, name: str, estimator: Estimator, recording: Recording, *, is_optimum: bool = False) -> None:
        """Run one, and keep its estimate or the reason why there is none."""
        try:
            self.estimates[name], seconds = run_estimator(name, estimator, recording)
        except UserError as error:
            self.failures[name] = str(error)
            return
        if not (isinstance(estimator, LoadedEstimator) and isinstance(estimator.estimate, StoredEstimate)):
            self.seconds[name] = seconds
        if is_optimum:
            self.optima[self.estimates[name].kind] = name


def run_side_by_side(
    estimators: Mapping[str, Estimator], recording: Recording, informed: Recording, misleading: Marks | None = None
) -> SideBySide:
    """Run every estimator on the recording, the optima on the informed one without what is `misleading` (M,).

    Where that has no ids, optima stand under the associations that the first of the others has made, `causal@ekf`.
    """
    entries = {name: entry_behind(estimator) for name, estimator in estimators.items()}
    optima = {name: entry for name, entry in entries.items() if entry is not None and entry.role == "optimum"}
    waiting = optima if informed.landmark is None else {}
    ran = SideBySide()
    with counted(len(estimators), "estimator") as progress:
        for name, estimator in estimators.items():
            progress.set_description(name)
            if name in optima and name not in waiting:
                ran.run(name, without(estimator, informed, misleading), informed, is_optimum=True)
            elif name not in waiting:
                ran.run(name, estimator, recording)
            progress.update()
    if informed.landmark is None:
        graphs = {name: entry for name, entry in entries.items() if entry is not None and entry.takes_associations}
        _stand_in(ran, waiting, graphs, estimators, recording)
    return ran


def with_stand_ins(names: Iterable[str]) -> set[str]:
    """Every name that an estimate may have where these estimators are asked for."""
    asked = {*names}
    return asked | {f"{optimum}{UNDER}{name}" for optimum in asked & {*OPTIMA.values()} for name in asked}


def _stand_in(
    ran: SideBySide,
    waiting: Mapping[str, Entry],
    graphs: Mapping[str, Entry],
    estimators: Mapping[str, Estimator],
    recording: Recording,
) -> None:
    """Run optima under the associations of the first that has any; what was asked for as `causal@ekf` will do."""
    makers = (name for name, each in ran.estimates.items() if name not in graphs and each.association is not None)
    maker = next(makers, None)
    for name, entry in waiting.items():
        if maker is None:
            ran.run(name, estimators[name], recording)  # which says why it cannot
        elif f"{name}{UNDER}{maker}" not in ran.estimates:
            stand_in = replace(entry, name=f"{name}{UNDER}{maker}")
            graph: Callable[..., Estimate] = entry.load()
            under = partial(graph, association=ran.estimates[maker].association)
            ran.run(stand_in.name, LoadedEstimator(stand_in, under), recording, is_optimum=True)
    for name, entry in graphs.items():
        kind = ran.estimates[name].kind if name in ran.estimates else None
        if kind is not None and entry.name.partition(UNDER)[0] == OPTIMA[kind]:
            ran.optima.setdefault(kind, name)
    ran.stand_ins.extend(ran.optima.values())
