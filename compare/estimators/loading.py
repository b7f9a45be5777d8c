"""Load requested estimators: built-in ones with their settings, graphs with a filter's associations, and user code."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from slamgauge.arrays import Marks
from slamgauge.compare.estimators.answers import Spent
from slamgauge.compare.estimators.captured_output import captured
from slamgauge.compare.estimators.causality_check import Strict
from slamgauge.compare.estimators.forms.form import remarks_of
from slamgauge.compare.estimators.isolated_process import Isolated
from slamgauge.compare.estimators.registry import REGISTRY, UNDER, Entry, entry_of
from slamgauge.compare.estimators.requests import Asked, Chosen, ask
from slamgauge.compare.estimators.user_code import Address
from slamgauge.compare.scenarios.schema import Association
from slamgauge.ekf.settings import NEAREST_NEIGHBOUR, PLAIN, FilterSettings, Initialisation, Robustness
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.notices import tell_first
from slamgauge.recording import Recording
from slamgauge.truth import NOBODY


@dataclass(frozen=True)
class LoadedEstimator:
    """An estimator with its entry of the registry; `form` describes user code and its loading."""

    entry: Entry
    estimate: Estimator
    form: str = ""

    def __call__(self, recording: Recording) -> Estimate:
        """Run the estimator."""
        return self.estimate(recording)

    def remarks(self, recording: Recording) -> list[str]:
        """Return remarks on the last run of user code."""
        return remarks_of(self.estimate, recording)


def load_estimators(
    chosen: Chosen,
    association: Association | None = None,
    initialisation: Initialisation | None = None,
    frames: int = 0,
    robust: Robustness = PLAIN,
) -> dict[str, LoadedEstimator]:
    """Load estimators, by the name of their results.

    Args:
        chosen: names of the registry, where `causal@ekf` is `causal` with the associations of `ekf`, and so for every
            graph and filter; addresses `[LABEL=]FILE.py:callable` or `[LABEL=]package.module:callable` of user code in
            any form of `slamgauge.adapters`; or a mapping from labels to these or to callables. User code is loaded and
            run; its imports are searched in the folder of the file, or the current folder, first.
        association: how filters associate a recording without ids. By default, and with `method` known, they use the
            nearest neighbour with gate 9.
        initialisation: how filters initialise landmarks in bearing-only recordings.
        frames: number of steps at which filters store their map, for pictures.
        robust: how filters protect their updates from outliers.

    Raises:
        UserError: a name is unknown or appears twice, or user code has no such callable.
    """
    return {each.label: load(each, association, initialisation, frames, robust=robust) for each in ask(chosen)}


def load_each(
    asked: Sequence[Asked],
    association: Association | None,
    initialisation: Initialisation | None,
    frames: int,
    robust: Robustness = PLAIN,
) -> tuple[dict[str, LoadedEstimator], dict[str, str]]:
    """Load estimators with the settings of `load_estimators`; return them by label, and the reasons of failures."""
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
    """Load one estimator with the settings of `load_estimators`; user code is loaded afresh and runs.

    If `announced`, the form of user code is printed on standard error.
    """
    if asked.is_bound:
        remedy = "`slamgauge study` compares the errors of many runs with it"
        raise UserError(f"{asked.name}: is a bound, which estimates nothing; {remedy}")
    if asked.name:
        return _ours(entry_of(asked.name), _settings(association, initialisation, frames, robust))
    from slamgauge.compare.estimators.adapters import FORM_NAMES, adapted_callable  # here: it loads the filters

    form, entry = "", Entry(name=asked.label, kind=None, role="user")
    if asked.where is not None and asked.isolation is not None:
        isolated = Strict if asked.isolation.strict else Isolated
        estimator = isolated(asked.where, asked.isolation.timeout, unconfined=asked.isolation.unconfined)
        form = estimator.begin()
    elif asked.where is not None:
        estimator, form = _adapted_quietly(asked.label, asked.where)
    else:
        assert asked.call is not None
        if (built_in := entry_behind(asked.call)) is not None:
            return LoadedEstimator(built_in, asked.call)
        estimator, form = adapted_callable(asked.call, asked.label)
    if announced and form:
        print(f"{asked.label}: {form}", file=sys.stderr)
        tell_first("form", f"forms follow from the code; --form NAME says otherwise ({', '.join(FORM_NAMES)})")
    return LoadedEstimator(entry, estimator, form)


def _adapted_quietly(label: str, where: Address) -> tuple[Estimator, str]:
    """Return `adapted(where)`; what the file prints is kept away, and an error shows its first lines."""
    from slamgauge.compare.estimators.adapters import adapted

    with captured(label) as output:
        try:
            return adapted(where)
        except UserError as error:
            raise UserError(f"{error}{output.as_reason}") from error


def without(optimum: Estimator, informed: Recording, misleading: Marks | None) -> Estimator:
    """Return an optimum that ignores the observations marked `misleading` (M,): clutter and outliers."""
    entry = entry_behind(optimum)
    if entry is None or misleading is None or not misleading.any() or informed.landmark is None:
        return optimum
    graph: Callable[..., Estimate] = entry.load()
    return LoadedEstimator(entry, partial(graph, association=np.where(misleading, NOBODY, informed.landmark)))


def spent_by(estimator: Estimator) -> Spent | None:
    """Return the times of the last run of an isolated estimator; None for any other."""
    within = estimator.estimate if isinstance(estimator, LoadedEstimator) else estimator
    return within.spent if isinstance(within, Isolated) else None


def entry_behind(estimator: Estimator) -> Entry | None:
    """Return the registry's entry of a callable, whatever its label; None if it is not a built-in estimator."""
    if isinstance(estimator, LoadedEstimator):
        return estimator.entry
    return next((entry for entry in REGISTRY.values() if entry.is_home_of(estimator)), None)


def _ours(entry: Entry, settings: FilterSettings) -> LoadedEstimator:
    estimate: Callable[..., Estimate] = entry.load()
    if entry.lag is not None:
        estimate = partial(estimate, lag=entry.lag)
    _, under, filter_name = entry.name.partition(UNDER)
    if under:
        slam: Callable[..., Estimate] = REGISTRY[filter_name].load()
        without_frames = replace(settings, frames=0)
        return LoadedEstimator(
            entry, lambda recording: estimate(recording, slam(recording, without_frames).association)
        )
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
