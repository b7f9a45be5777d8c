"""Names become estimators: ours with their settings, graphs under a filter's associations, people's own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from slamgauge.compare.estimators.adapters import adapted
from slamgauge.compare.estimators.own import Address, address
from slamgauge.compare.estimators.registry import REGISTRY, UNDER, Entry, entry_of
from slamgauge.compare.scenarios.schema import Association
from slamgauge.ekf.settings.initialisation import Initialisation
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.recording import Recording


@dataclass(frozen=True)
class LoadedEstimator:
    """An estimator with what the registry says of it; called like any."""

    entry: Entry
    estimate: Estimator

    def __call__(self, recording: Recording) -> Estimate:
        """Run it."""
        return self.estimate(recording)


def load_estimators(
    names: Sequence[str],
    own: Sequence[str] = (),
    association: Association | None = None,
    initialisation: Initialisation | None = None,
    frames: int = 0,
) -> dict[str, LoadedEstimator]:
    """Estimators by the name that results carry.

    Args:
        names: of the registry; `isam2@ekf` is isam2 under the associations that ekf makes, and so for every graph
            and filter.
        own: people's own, `[LABEL=]FILE.py:callable` or `[LABEL=]package.module:callable`, in any of the forms of
            `slamgauge.adapters`; this loads and runs the code found there, with the file's folder, or the current
            one, searched first.
        association: how filters associate a recording without ids; theirs by default is the nearest neighbour at
            gate 9. With `method` known, too: there they have ids.
        initialisation: how filters initialise landmarks where the recording has bearings alone.
        frames: at how many steps filters keep their map, for pictures.

    Raises:
        UserError: an unknown name, one that stands there twice, or an own one that leads to no callable.
    """
    settings = _settings(association, initialisation)
    entries = {name: entry_of(name) for name in names}
    addresses = [address(text) for text in own]
    for where in addresses:
        _refuse_taken(where, [*REGISTRY, *entries], addresses)
    loaded = {name: _ours(entry, settings, frames) for name, entry in entries.items()}
    return loaded | {where.label: _own(where) for where in addresses}


def entry_behind(estimator: Estimator) -> Entry | None:
    """What the registry says of a callable, whatever name it goes by; None if it is not known there."""
    if isinstance(estimator, LoadedEstimator):
        return estimator.entry
    return next((entry for entry in REGISTRY.values() if entry.is_home_of(estimator)), None)


def _ours(entry: Entry, settings: dict[str, object], frames: int) -> LoadedEstimator:
    estimate: Callable[..., Estimate] = entry.load()
    graph, under, filter_name = entry.name.partition(UNDER)
    if under:
        slam = partial(REGISTRY[filter_name].load(), **settings)
        return LoadedEstimator(entry, _under_associations(REGISTRY[graph].load(), slam))
    if entry.is_filter:
        estimate = partial(estimate, **settings, **({"frames": frames} if frames else {}))
    return LoadedEstimator(entry, estimate)


def _own(where: Address) -> LoadedEstimator:
    entry = Entry(name=where.label, kind=None, is_own=True, is_benched=False)
    return LoadedEstimator(entry, adapted(where))


def _settings(association: Association | None, initialisation: Initialisation | None) -> dict[str, object]:
    """A scenario's settings as a filter takes them."""
    chosen = {"association": None if association is None else association.settings(), "initialisation": initialisation}
    return {key: value for key, value in chosen.items() if value is not None}


def _under_associations(graph: Callable[..., Estimate], slam: Callable[..., Estimate]) -> Estimator:
    """The graph with the associations that a filter makes of the same recording, as they stand at its end."""
    return lambda recording: graph(recording, slam(recording).association)


def _refuse_taken(where: Address, ours: Sequence[str], addresses: Sequence[Address]) -> None:
    """Two estimators of one name would share a row."""
    count = sum(other.label == where.label for other in addresses)
    if where.label in ours or count > 1:
        whose = "one of ours" if where.label in ours else "two of yours"
        raise UserError(f"estimator {where.text!r}: {where.label} is {whose}; write another LABEL= in front")
