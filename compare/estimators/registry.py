"""Registry of built-in estimators: a new one needs a function and an entry here.

Functions are imported when an estimator is loaded, so that help texts appear at once.
"""

from __future__ import annotations

import importlib
import re
from dataclasses import KW_ONLY, dataclass, replace
from typing import TYPE_CHECKING, Literal, cast

from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable

    from slamgauge.arrays import Float
    from slamgauge.estimate import Estimator, Kind
    from slamgauge.recording import Recording
    from slamgauge.truth import Truth

DEAD_RECKONING = "dead-reckoning"  # faint in figures, absent from pictures of a map
FIXED_LAG = "fixed-lag"  # fixed-lag-50: a window of 50 steps
LAG = "0|[1-9][0-9]{0,8}"  # pattern of the steps at the end of a name
UNDER = "@"  # causal@ekf: causal with the associations of ekf
Role = Literal["estimator", "textbook", "filter", "graph", "informed", "optimum", "bound", "user"]


@dataclass(frozen=True)
class Entry:
    """An estimator.

    Attributes:
        name: name that users write and results contain.
        home: place of its function, `module:attribute`; empty for user code.
        role: arguments of its function, and its use in comparisons.
            `estimator`: takes the recording alone.
            `textbook`: also takes the association settings of a filter.
            `filter`: also takes a filter's settings; `ekf.maps.correction_table` has its correction under this name.
            `graph`: also takes associations, as in `causal@ekf`.
            `informed`: a graph that receives the true noise and associations.
            `optimum`: an informed graph that others of its kind are compared with.
            `bound`: takes truth and recording; no error of an estimator is below it.
            `user`: user code; its output and errors are reported as the user's.
        kind: kind of its estimates; None if it is unknown before a run.
        note: short description for help texts.
        lag: steps of the window that its name states, as in `fixed-lag-50`.
        title: its name as an optimum in figures.
    """

    name: str
    home: str = ""
    role: Role = "estimator"
    _: KW_ONLY
    kind: Kind | None = "filtered"
    note: str = ""
    lag: int | None = None
    title: str = ""

    @property
    def takes_associations(self) -> bool:
        """Whether its function takes associations, as in `causal@ekf`."""
        return self.role in ("graph", "informed", "optimum")

    @property
    def is_informed(self) -> bool:
        """Whether it receives the true noise and associations."""
        return self.role in ("informed", "optimum")

    def load(self) -> Estimator:
        """Import its function."""
        module, _, attribute = self.home.partition(":")
        return getattr(importlib.import_module(module), attribute)

    def bounds(self, truth: Truth, recording: Recording) -> Float:
        """Return the covariances (N+1, 3, 3) of a bound."""
        return cast("Callable[[Truth, Recording], Float]", self.load())(truth, recording)


_FILTER, _GRAPH = "slamgauge.ekf:", "slamgauge.graph_baseline:"
_ENTRIES = (
    Entry(DEAD_RECKONING, f"{_FILTER}dead_reckoning"),
    Entry("textbook-ekf", f"{_FILTER}textbook_ekf", "textbook", note="the same as ekf in 200 lines, for reading"),
    Entry("ekf", f"{_FILTER}ekf_slam", "filter"),
    Entry("fej-ekf", f"{_FILTER}fej_ekf", "filter"),
    Entry("oc-ekf", f"{_FILTER}oc_ekf", "filter"),
    Entry("iekf", f"{_FILTER}iekf", "filter"),
    Entry("riekf", f"{_FILTER}riekf", "filter"),
    Entry(FIXED_LAG, f"{_GRAPH}fixed_lag", "graph", note=f"the last 20 steps smoothed; {FIXED_LAG}-5: the last 5"),
    Entry("causal", f"{_GRAPH}causal", "optimum", note="causal optimum", title="causal optimum"),
    Entry("batch", f"{_GRAPH}batch", "optimum", kind="smoothed", note="hindsight", title="hindsight optimum"),
    Entry("robust-batch", f"{_GRAPH}robust_batch", "graph", kind="smoothed"),
    Entry("isam2", f"{_GRAPH}isam2", "graph", note="GTSAM's iSAM2"),
    Entry("gtsam-batch", f"{_GRAPH}gtsam_batch", "informed", kind="smoothed", note="GTSAM's Levenberg-Marquardt"),
)
REGISTRY = {entry.name: entry for entry in _ENTRIES}
BOUND, HINDSIGHT_BOUND = "bound", "hindsight-bound"
_NOTE = "for studies: Cramer-Rao bounds, causal and in hindsight"
BOUNDS = {  # for studies only: they need the truth and many runs
    BOUND: Entry(BOUND, f"{_GRAPH}causal_bound", "bound", note=_NOTE),
    HINDSIGHT_BOUND: Entry(HINDSIGHT_BOUND, f"{_GRAPH}hindsight_bound", "bound", kind="smoothed"),
}
BOUND_OF = {str(entry.kind): entry.name for entry in BOUNDS.values()}  # kind of estimates -> bound
FILTERS = tuple(entry.name for entry in _ENTRIES if entry.role == "filter")
GRAPHS = tuple(entry.name for entry in _ENTRIES if entry.takes_associations)
OPTIMA = {str(entry.kind): entry.name for entry in _ENTRIES if entry.role == "optimum"}  # kind of estimates -> optimum
CAUSAL, HINDSIGHT = OPTIMA["filtered"], OPTIMA["smoothed"]
BENCHED = ",".join((DEAD_RECKONING, *FILTERS, *OPTIMA.values()))  # default of `slamgauge bench`
HELP = (
    f"Comma-separated: {', '.join(f'{each.name} ({each.note})' if each.note else each.name for each in _ENTRIES)}; "
    f"{CAUSAL}{UNDER}{FILTERS[0]} is {CAUSAL} with the associations of {FILTERS[0]}."
)


def entry_of(name: str) -> Entry:
    """Return the entry of a name, also of `causal@ekf` (a graph with a filter's associations) and `fixed-lag-5`."""
    graph, under, filter_name = name.partition(UNDER)
    stem, _, steps = graph.rpartition("-")
    entry = (REGISTRY | BOUNDS).get(graph)
    if stem == FIXED_LAG and re.fullmatch(LAG, steps):
        entry = replace(REGISTRY[stem], name=graph, note="", lag=int(steps))
    if entry is not None and not under:
        return entry
    if entry is not None and entry.takes_associations and filter_name in FILTERS:
        return replace(entry, name=name, role="graph", note="", title="")
    remedy = did_you_mean(graph, REGISTRY)
    if entry is not None:
        remedy = f"write GRAPH@FILTER with one of {', '.join(GRAPHS)} and one of {', '.join(FILTERS)}"
    elif stem == FIXED_LAG and steps.isdecimal():
        remedy = f"write {stem}-N with a number N of steps from 1 to 999999999"
    raise UserError(f"estimator {name!r} is not known; {remedy}")


def is_ours(name: str) -> bool:
    """Return whether a name is that of a built-in estimator."""
    try:
        entry_of(name)
    except UserError:
        return False
    return True


def is_optimum(name: str) -> bool:
    """Return whether a name is that of an optimum."""
    return name in OPTIMA.values()
