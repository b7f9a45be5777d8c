"""Load requested estimators: built-in ones with their settings, graphs with a filter's associations, and user code.

With `strict` filtered estimates of user code must use no later measurements: the estimate of a step must not depend on
them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from slamgauge.arrays import Marks
from slamgauge.compare.estimators.adapters import adapt
from slamgauge.compare.estimators.child import Host, shared_host
from slamgauge.compare.estimators.forms.signatures import Form, Noise
from slamgauge.compare.estimators.registry import REGISTRY, UNDER, Entry, entry_of
from slamgauge.compare.estimators.requests import Asked, BuiltIn, Chosen, UserCode, ask
from slamgauge.compare.estimators.user_errors import UserCodeError
from slamgauge.compare.scenarios.schema import Association
from slamgauge.ekf.settings import NEAREST_NEIGHBOUR, PLAIN, FilterSettings, Initialisation, Robustness
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.recording import Recording
from slamgauge.se2 import wrap
from slamgauge.truth import NOBODY

PARTS = (0.25, 0.5, 0.75)  # fractions of the recording on which it runs again
JITTER = 0.1  # largest random change of a fraction, so that no code can know where its runs will end
SAME_POSE = 1e-5  # [m], [rad]: far above rounding, far below the effect of a measurement
SAME_COV = 1e-3  # relative to the product of both sigmas


@dataclass(frozen=True)
class LoadedEstimator:
    """An estimator with its entry of the registry; `form` describes user code."""

    entry: Entry
    estimate: Estimator
    form: str = ""

    def __call__(self, recording: Recording) -> Estimate:
        """Run the estimator."""
        return self.estimate(recording)


class HostedEstimator(Form):
    """User code as an estimator, which runs in its child process; `seconds` and remarks are those of the last run.

    If `strict`, filtered estimates are checked for use of the future; prefixes run in a process of their own.
    """

    def __init__(self, host: Host, noise: Noise = "recording", *, strict: bool = False) -> None:
        self.host, self.noise, self.strict = host, noise, strict
        self.words = host.begin()
        self.seconds: float | None = None

    def __call__(self, recording: Recording) -> Estimate:
        """Run the code; `UserCodeError`: it raised an error, exceeded its limits, or uses the future."""
        self.remarks = ()
        run = self.host.run(recording, self.noise)
        self.remarks, self.replaces_noise, self.seconds = run.remarks, run.replaces_noise, run.seconds
        if self.strict:
            with closing(Host(self.host.where, self.host.limits)) as prefixes:
                require_causal(prefixes, recording, run.estimate)
        return run.estimate


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
        estimator: Estimator = HostedEstimator(shared_host(asked.where, asked.limits), asked.noise, strict=asked.strict)
    elif (built_in := entry_behind(asked.call)) is not None:
        return LoadedEstimator(built_in, asked.call)
    else:
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
    for entry in REGISTRY.values():
        module, _, attribute = entry.home.partition(":")
        is_named = getattr(estimator, "__name__", None) == attribute  # else nothing is imported
        if is_named and getattr(sys.modules.get(module), attribute, None) is estimator:
            return entry
    return None


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


def require_causal(host: Host, recording: Recording, estimate: Estimate) -> None:
    """Refuse a filtered estimate that differs from the estimates of the recordings up to some steps.

    The process `host` estimates these in the order of their lengths; it has never received later measurements.
    """
    if estimate.kind != "filtered" or len(estimate.poses) != recording.steps + 1:  # `run_estimator` refuses the latter
        return
    parts = np.add(PARTS, np.random.default_rng().uniform(-JITTER, JITTER, len(PARTS)))
    steps = sorted({int(part * recording.steps) for part in parts} - {0})
    for step in steps:
        if what := _difference(estimate, host.run(recording.first(step)).estimate, step):
            answers = [host.run(recording.first(step)).estimate for _ in range(2)]
            if _difference(*answers, last=len(answers[0].poses) - 1):  # the check cannot judge it
                remedy = "seed its random numbers, and draw them step by step"
                raise UserCodeError(f"its answers to one recording differ from run to run; {remedy}")
            remedy = "store a pose before the next step begins, or say kind='smoothed'"
            raise UserCodeError(f"uses the future: from the recording up to step {step} alone, {what}; {remedy}")


def _difference(estimate: Estimate, part: Estimate, last: int) -> str:
    """Describe the first difference up to step `last` from an estimate that ends there; empty if they agree."""
    if len(part.poses) != last + 1:
        return f"it returns {len(part.poses)} poses, not {last + 1}"
    apart = np.abs(estimate.poses[: last + 1] - part.poses)
    apart[:, 2] = np.abs(wrap(apart[:, 2]))
    moved = (apart > SAME_POSE).any(axis=1)
    if moved.any():
        step = int(moved.argmax())
        return f"the pose of step {step} is another, {apart[step].max():.2g} m or rad away"
    if estimate.pose_covs is None or part.pose_covs is None:
        return ""
    covs = estimate.pose_covs[: last + 1]
    sigmas = np.sqrt(np.diagonal(covs, axis1=1, axis2=2))
    bounds = SAME_COV * sigmas[:, :, None] * sigmas[:, None, :] + SAME_POSE**2
    changed = (np.abs(covs - part.pose_covs) > bounds).any(axis=(1, 2))
    return f"the covariance of step {int(changed.argmax())} is another" if changed.any() else ""
