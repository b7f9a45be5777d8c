"""Names become estimators: ours with their settings, graphs under a filter's associations, people's own."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from slamgauge.arrays import Marks
from slamgauge.compare.estimators.adapters import adapt, adapted
from slamgauge.compare.estimators.causality_check import Strict
from slamgauge.compare.estimators.isolated_process import Isolated, Spent
from slamgauge.compare.estimators.registry import REGISTRY, UNDER, Entry, entry_of
from slamgauge.compare.estimators.requests import Asked, Chosen, Isolation, ask
from slamgauge.compare.estimators.user_code import Address
from slamgauge.compare.scenarios.schema import Association
from slamgauge.ekf.settings import NEAREST_NEIGHBOUR, PLAIN, FilterSettings, Initialisation, Robustness
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.recording import Recording
from slamgauge.truth import NOBODY


@dataclass(frozen=True)
class LoadedEstimator:
    """An estimator with what the registry says of it; called like any."""

    entry: Entry
    estimate: Estimator

    def __call__(self, recording: Recording) -> Estimate:
        """Run it."""
        return self.estimate(recording)


def load_estimators(
    chosen: Chosen,
    association: Association | None = None,
    initialisation: Initialisation | None = None,
    frames: int = 0,
    robust: Robustness = PLAIN,
) -> dict[str, LoadedEstimator]:
    """Estimators by the name that results carry.

    Args:
        chosen: names of the registry, `causal@ekf` is causal under the associations that ekf makes, and so for every
            graph and filter; addresses `[LABEL=]FILE.py:callable` or `[LABEL=]package.module:callable` of people's
            own, in any of the forms of `slamgauge.adapters`, and this loads and runs the code found there, with the
            file's folder, or the current one, searched first; or a mapping from labels to either, or to callables.
        association: how filters associate a recording without ids; theirs by default is the nearest neighbour at
            gate 9. With `method` known, too: there they have ids.
        initialisation: how filters initialise landmarks where the recording has bearings alone.
        frames: at how many steps filters keep their map, for pictures.
        robust: how filters guard their updates against outliers.

    Raises:
        UserError: an unknown name, one that stands there twice, or an own one that leads to no callable.
    """
    return {each.label: load(each, association, initialisation, frames, robust=robust) for each in ask(chosen)}


def load_each(
    asked: Sequence[Asked],
    association: Association | None,
    initialisation: Initialisation | None,
    frames: int,
    robust: Robustness = PLAIN,
) -> tuple[dict[str, LoadedEstimator], dict[str, str]]:
    """Estimators by label, with the settings of `load_estimators`, and of those that cannot be loaded the reason."""
    loaded: dict[str, LoadedEstimator] = {}
    failures: dict[str, str] = {}
    for each in asked:
        try:
            loaded[each.label] = load(each, association, initialisation, frames, robust=robust)
        except UserError as error:
            failures[each.label] = str(error)
    return loaded, failures


def load(
    asked: Asked,
    association: Association | None = None,
    initialisation: Initialisation | None = None,
    frames: int = 0,
    *,
    robust: Robustness = PLAIN,
    announced: bool = True,
) -> LoadedEstimator:
    """One estimator, with the settings of `load_estimators`; people's own code is loaded afresh, and runs.

    The form in which they bring it is said on standard error, if it is to be `announced`.
    """
    if asked.is_bound:
        raise UserError(
            f"{asked.name}: is no estimate of a recording; `slamgauge study` holds errors of many runs to it"
        )
    if asked.name:
        return _ours(entry_of(asked.name), _settings(association, initialisation, frames, robust))
    own = Entry(name=asked.label, kind=None, role="user")
    if asked.where is not None and asked.isolation is not None:
        return LoadedEstimator(own, _apart(asked.where, asked.isolation, announced=announced))
    if asked.where is not None:
        return LoadedEstimator(own, adapted(asked.where, announced=announced))
    assert asked.call is not None
    entry = entry_behind(asked.call)
    return LoadedEstimator(entry or own, asked.call if entry else adapt(asked.call, asked.label, announced=announced))


def without(optimum: Estimator, informed: Recording, misleading: Marks | None) -> Estimator:
    """An optimum that leaves out what is `misleading` (M,), clutter and outliers, in the recording that it is told."""
    entry = entry_behind(optimum)
    if entry is None or misleading is None or not misleading.any() or informed.landmark is None:
        return optimum
    graph: Callable[..., Estimate] = entry.load()
    return LoadedEstimator(entry, partial(graph, association=np.where(misleading, NOBODY, informed.landmark)))


def spent_by(estimator: Estimator) -> Spent | None:
    """What the last run of an estimator in a process of its own has cost there; None of any other."""
    within = estimator.estimate if isinstance(estimator, LoadedEstimator) else estimator
    return within.spent if isinstance(within, Isolated | Strict) else None


def entry_behind(estimator: Estimator) -> Entry | None:
    """What the registry says of a callable, whatever name it goes by; None if it is not known there."""
    if isinstance(estimator, LoadedEstimator):
        return estimator.entry
    return next((entry for entry in REGISTRY.values() if entry.is_home_of(estimator)), None)


def _apart(where: Address, isolation: Isolation, *, announced: bool) -> Isolated | Strict:
    estimator = Isolated(where, isolation.timeout)
    form = estimator.begin()
    if announced and form:
        print(f"{where.label}: {form}", file=sys.stderr)
    return Strict(estimator) if isolation.strict else estimator


def _ours(entry: Entry, settings: FilterSettings) -> LoadedEstimator:
    estimate: Callable[..., Estimate] = entry.load()
    if entry.lag is not None:
        estimate = partial(estimate, lag=entry.lag)
    _, under, filter_name = entry.name.partition(UNDER)
    if under:
        slam: Callable[..., Estimate] = REGISTRY[filter_name].load()
        named = partial(slam, settings=replace(settings, frames=0))
        return LoadedEstimator(entry, _under_associations(estimate, named))
    if entry.role == "filter":
        estimate = partial(estimate, settings=settings)
    if entry.role == "textbook" and settings.association != NEAREST_NEIGHBOUR:
        estimate = partial(estimate, association=settings.association)
    return LoadedEstimator(entry, estimate)


def _settings(
    association: Association | None, initialisation: Initialisation | None, frames: int, robust: Robustness
) -> FilterSettings:
    """Return a scenario's settings as a filter takes them."""
    settings = FilterSettings(frames=frames, robust=robust)
    if association is not None and (chosen := association.settings()) is not None:
        settings = replace(settings, association=chosen)
    if initialisation is not None:
        settings = replace(settings, initialisation=initialisation)
    return settings


def _under_associations(graph: Callable[..., Estimate], slam: Callable[..., Estimate]) -> Estimator:
    """The graph with the associations that a filter makes of the same recording, as they stand at its end."""
    return lambda recording: graph(recording, slam(recording).association)
