"""Every built-in estimator, described once: adding one takes a function and an entry here.

Nothing is imported before it is asked for, so that the help of a command that lists them answers at once.
"""

from __future__ import annotations

import importlib
import re
import sys
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple, cast

from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable

    from slamgauge.arrays import Float
    from slamgauge.estimate import Estimator, Kind
    from slamgauge.recording import Recording
    from slamgauge.truth import Truth

DEAD_RECKONING = "dead-reckoning"  # what figures show faintly, and pictures of a map leave out
FIXED_LAG, SLIDING_WINDOW = LAGGING = ("fixed-lag", "sliding-window")  # fixed-lag-50: of 50 steps
LAG = "0|[1-9][0-9]{0,8}"  # as a name ends
UNDER = "@"  # causal@ekf: causal under the associations that ekf makes


class Look(NamedTuple):
    """Colour and dashes of an estimator's curves (offset, then lengths on and off, in line widths)."""

    color: str
    dashes: tuple[int, tuple[float, ...]]


Role = Literal["estimator", "textbook", "filter", "graph", "optimum", "bound", "user"]


@dataclass(frozen=True, kw_only=True)
class Entry:
    """An estimator.

    Attributes:
        name: what users write, and what results carry.
        home: place of its function, `module:attribute`; empty for user code.
        role: what its function takes, and what others may compare with it.
            `estimator`: takes the recording alone.
            `textbook`: also takes the association of a filter's settings.
            `filter`: also takes a filter's settings; `ekf.maps.correction_table` has its correction under this name.
            `graph`: also takes associations, as in `causal@ekf`.
            `optimum`: a graph that others of its kind are compared with; it receives the true noise and associations.
            `bound`: takes truth and recording; no estimator's error is below it.
            `user`: user code; its output and errors are reported as the user's.
        kind: kind of its estimates; None if only the estimate itself says so.
        note: short description for help texts.
        lag: steps of the window that its name states, as in `fixed-lag-50`.
        title: its name as an optimum in figures.
        look: colour and dashes of its curves; None takes a free one.
    """

    name: str
    home: str = ""
    role: Role = "estimator"
    kind: Kind | None = "filtered"
    note: str = ""
    lag: int | None = None
    title: str = ""
    look: Look | None = None

    @property
    def takes_associations(self) -> bool:
        """Whether its function takes associations, as in `causal@ekf`."""
        return self.role in ("graph", "optimum")

    def load(self) -> Estimator:
        """Its function, imported now."""
        module, _, attribute = self.home.partition(":")
        return getattr(importlib.import_module(module), attribute)

    def bounds(self, truth: Truth, recording: Recording) -> Float:
        """Of a bound: covariances (N+1, 3, 3) that no error's is below."""
        return cast("Callable[[Truth, Recording], Float]", self.load())(truth, recording)

    def is_home_of(self, estimator: object) -> bool:
        """Whether `estimator` is its function; nothing is imported to find out."""
        module, _, attribute = self.home.partition(":")
        named = getattr(estimator, "__name__", None) == attribute and module in sys.modules
        return named and getattr(sys.modules[module], attribute, None) is estimator


# colours after P. Tol, "Colour schemes" (SRON/EPS/TN/09-002)
_ENTRIES = (
    Entry(
        name=DEAD_RECKONING,
        home="slamgauge.ekf:dead_reckoning",
        look=Look("#009988", (0, (1, 1.4))),
    ),
    Entry(
        name="textbook-ekf",
        home="slamgauge.ekf:textbook_ekf",
        role="textbook",
        note="the same as ekf in 200 lines, for reading",
        look=Look("#6A5ACD", (0, (7, 3))),
    ),
    Entry(
        name="ekf",
        home="slamgauge.ekf:ekf_slam",
        role="filter",
        look=Look("#CC3311", (0, (5, 1.2))),
    ),
    Entry(
        name="fej-ekf",
        home="slamgauge.ekf:fej_ekf",
        role="filter",
        look=Look("#33BBEE", (0, (3, 1, 1, 1, 1, 1))),
    ),
    Entry(
        name="oc-ekf",
        home="slamgauge.ekf:oc_ekf",
        role="filter",
        look=Look("#EE3377", (0, (6, 1, 1, 1, 3, 1))),
    ),
    Entry(
        name="iekf",
        home="slamgauge.ekf:iekf",
        role="filter",
        look=Look("#775522", (0, (9, 2))),
    ),
    Entry(
        name="riekf",
        home="slamgauge.ekf:riekf",
        role="filter",
        look=Look("#0077BB", (0, (4, 1, 1, 1))),
    ),
    Entry(
        name="riukf",
        home="slamgauge.ekf:riukf",
        note="right-invariant, with sigma points",
        look=Look("#AA4499", (0, (2, 1, 5, 1))),
    ),
    Entry(
        name="robocentric-ekf",
        home="slamgauge.ekf:robocentric_ekf",
        note="map in the robot's frame",
        look=Look("#117733", (0, (8, 1, 2, 1))),
    ),
    Entry(
        name=SLIDING_WINDOW,
        home="slamgauge.ekf:sliding_window",
        note=f"filter, the last 100 steps linearised anew; {SLIDING_WINDOW}-50: the last 50",
        look=Look("#661100", (0, (5, 1, 1, 1, 1, 1))),
    ),
    Entry(
        name=FIXED_LAG,
        home="slamgauge.graph_baseline:fixed_lag",
        note=f"the last 20 steps smoothed; {FIXED_LAG}-5: the last 5",
        role="graph",
    ),
    Entry(
        name="causal",
        home="slamgauge.graph_baseline:causal",
        note="causal optimum",
        role="optimum",
        title="causal optimum",
        look=Look("#CC9900", (0, (2, 1))),
    ),
    Entry(
        name="batch",
        home="slamgauge.graph_baseline:batch",
        kind="smoothed",
        note="hindsight",
        role="optimum",
        title="hindsight optimum",
        look=Look("#882288", (0, (7, 1, 1, 1, 1, 1))),
    ),
    Entry(
        name="robust-batch",
        home="slamgauge.graph_baseline:robust_batch",
        kind="smoothed",
        role="graph",
    ),
    Entry(
        name="isam2",
        home="slamgauge.graph_baseline:isam2",
        note="GTSAM's iSAM2",
        role="graph",
        look=Look("#AAAA00", (0, (3, 3))),
    ),
    Entry(
        name="gtsam-batch",
        home="slamgauge.graph_baseline:gtsam_batch",
        kind="smoothed",
        note="GTSAM's Levenberg-Marquardt",
        role="graph",
        look=Look("#CC6677", (0, (10, 2, 2, 2))),
    ),
)
REGISTRY = {entry.name: entry for entry in _ENTRIES}
BOUND, HINDSIGHT_BOUND = "bound", "hindsight-bound"
BOUNDS = {  # of studies: these need the truth, and many runs
    BOUND: Entry(
        name=BOUND,
        home="slamgauge.graph_baseline:causal_bound",
        note="of studies: what no estimator can beat, causal and in hindsight",
        role="bound",
        look=Look("#000000", (0, (1, 1))),
    ),
    HINDSIGHT_BOUND: Entry(
        name=HINDSIGHT_BOUND,
        home="slamgauge.graph_baseline:hindsight_bound",
        kind="smoothed",
        role="bound",
        look=Look("#777777", (0, (1, 2))),
    ),
}
BOUND_OF = {str(entry.kind): entry.name for entry in BOUNDS.values()}  # by the kind that they bound
FILTERS = tuple(entry.name for entry in _ENTRIES if entry.role == "filter")
GRAPHS = tuple(entry.name for entry in _ENTRIES if entry.takes_associations)
OPTIMA = {str(entry.kind): entry.name for entry in _ENTRIES if entry.role == "optimum"}  # by the kind of estimates
CAUSAL, HINDSIGHT = OPTIMA["filtered"], OPTIMA["smoothed"]
BENCHED = ",".join((DEAD_RECKONING, *FILTERS, *OPTIMA.values()))  # what `slamgauge bench` measures by default
HELP = (
    f"Comma-separated: {', '.join(f'{each.name} ({each.note})' if each.note else each.name for each in _ENTRIES)}; "
    f"{CAUSAL}{UNDER}{FILTERS[0]} is {CAUSAL} under the associations that {FILTERS[0]} makes."
)


def entry_of(name: str) -> Entry:
    """The entry of a name; `causal@ekf`, a graph under a filter's associations, and `fixed-lag-5` have one like any.

    Raises:
        UserError: an unknown name.
    """
    graph, under, filter_name = name.partition(UNDER)
    entry = _plain_entry_of(graph)
    if entry is not None and not under:
        return entry
    if entry is not None and entry.takes_associations and filter_name in FILTERS:
        return replace(entry, name=name, role="graph", note="", title="", look=None)
    if under and entry is not None:
        remedy = f"write GRAPH@FILTER with one of {', '.join(GRAPHS)} and one of {', '.join(FILTERS)}"
    else:
        remedy = did_you_mean(graph, REGISTRY)
    raise UserError(f"estimator {name!r} is not known; {remedy}")


def _plain_entry_of(name: str) -> Entry | None:
    """The entry of a name without a filter behind it, if there is one."""
    stem, _, steps = name.rpartition("-")
    if stem in LAGGING and re.fullmatch(LAG, steps):
        return replace(REGISTRY[stem], name=name, note="", lag=int(steps))
    return (REGISTRY | BOUNDS).get(name)


def is_ours(name: str) -> bool:
    """Whether a name has an entry."""
    try:
        entry_of(name)
    except UserError:
        return False
    return True


def is_optimum(name: str) -> bool:
    """Whether a name, as `load_estimators` takes it, is that of an optimum."""
    return name in OPTIMA.values()
