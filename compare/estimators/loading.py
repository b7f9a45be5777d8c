"""Load requested estimators: built-in ones with their settings, graphs with a filter's associations, and user code."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from slamgauge.arrays import Marks
from slamgauge.compare.estimators.causality_check import require_causal
from slamgauge.compare.estimators.child import Host, Run, shared_host
from slamgauge.compare.estimators.forms.signatures import Form, Noise
from slamgauge.compare.estimators.registry import REGISTRY, UNDER, Entry, entry_of
from slamgauge.compare.estimators.requests import Asked, BuiltIn, Chosen, UserCode, ask
from slamgauge.compare.scenarios.schema import Association
from slamgauge.ekf.settings import NEAREST_NEIGHBOUR, PLAIN, FilterSettings, Initialisation, Robustness
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.recording import Recording
from slamgauge.truth import NOBODY


@dataclass(frozen=True)
class LoadedEstimator:
    """An estimator with its entry of the registry; `form` describes user code."""

    entry: Entry
    estimate: Estimator
    form: str = ""

    def __call__(self, recording: Recording) -> Estimate:
        """Run the estimator."""
        return self.estimate(recording)


@dataclass
class HostedEstimator:
    """User code as an estimator, which runs in its child process.

    Attributes:
        host: the process.
        noise: noise that it assumes.
        strict: whether filtered estimates are checked for use of the future; prefixes run in a process of their own.
        last: the last run; None before.
    """

    host: Host
    noise: Noise = "recording"
    strict: bool = False
    last: Run | None = None

    def __call__(self, recording: Recording) -> Estimate:
        """Run the code.

        Raises:
            UserCodeError: it raised an error, exceeded its limits, or uses the future.
        """
        self.last = None
        self.last = self.host.run(recording, self.noise)
        if self.strict:
            with closing(Host(self.host.where, self.host.limits)) as prefixes:
                require_causal(prefixes, recording, self.last.estimate)
        return self.last.estimate

    @property
    def remarks(self) -> list[str]:
        """Remarks on the last run, for example replaced settings."""
        return [] if self.last is None else self.last.remarks


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
            any form of `slamgauge.adapters`; or a mapping from labels to these or to callables. User code at an address
            is loaded and run in a child process, in the folder of the file or else the current folder.
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
    """Load one estimator with the settings of `load_estimators`; user code is loaded, and runs.

    If `announced`, the form of user code is printed on standard error.
    """
    if isinstance(asked, BuiltIn) and asked.is_bound:
        remedy = "`slamgauge study` compares the errors of many runs with it"
        raise UserError(f"{asked.name}: is a bound, which estimates nothing; {remedy}")
    if isinstance(asked, BuiltIn):
        settings = FilterSettings(frames=frames, robust=robust)
        if association is not None and (chosen := association.settings()) is not None:
            settings = replace(settings, association=chosen)
        if initialisation is not None:
            settings = replace(settings, initialisation=initialisation)
        return _ours(entry_of(asked.name), settings)
    entry = Entry(name=asked.label, kind=None, role="user")
    if isinstance(asked, UserCode):
        host = shared_host(asked.where, asked.limits)
        form = host.begin()
        estimator: Estimator = HostedEstimator(host, asked.noise, asked.strict)
    else:
        if (built_in := entry_behind(asked.call)) is not None:
            return LoadedEstimator(built_in, asked.call)
        from slamgauge.compare.estimators.adapters import adapt  # here: it loads the filters

        estimator = adapt(asked.call, asked.label)
        form = estimator.words if isinstance(estimator, Form) else ""
    if announced and form:
        print(f"{asked.label}: {form}", file=sys.stderr)
    return LoadedEstimator(entry, estimator, form)


def without(optimum: Estimator, informed: Recording, misleading: Marks | None) -> Estimator:
    """Return an optimum that ignores the observations marked `misleading` (M,): clutter and outliers."""
    entry = entry_behind(optimum)
    if entry is None or misleading is None or not misleading.any() or informed.landmark is None:
        return optimum
    graph: Callable[..., Estimate] = entry.load()
    return LoadedEstimator(entry, partial(graph, association=np.where(misleading, NOBODY, informed.landmark)))


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
        plain = replace(settings, frames=0)
        return LoadedEstimator(entry, lambda recording: estimate(recording, slam(recording, plain).association))
    if entry.role == "filter":
        estimate = partial(estimate, settings=settings)
    if entry.role == "textbook" and settings.association != NEAREST_NEIGHBOUR:
        estimate = partial(estimate, association=settings.association)
    return LoadedEstimator(entry, estimate)
