"""Every built-in estimator, described once: adding one takes a function and an entry here.

Nothing is imported before it is asked for, so that the help of a command that lists them answers at once.
"""

from __future__ import annotations

import importlib
import re
import sys
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, cast

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


@dataclass(frozen=True, kw_only=True)
class Entry:
    """An estimator.

    Attributes:
        name: what people write, and what results carry.
        home: where its function stands, `module:attribute`; empty for people's own.
        kind: of its estimates; None where only they can tell.
        note: what it is, in a word or two for help texts.
        is_filter: whether it takes a filter's settings: how it associates, how landmarks begin, at how many steps it
            keeps its map. Its rule of correction is that of `ekf.maps.correction_table` for this name.
        is_graph: whether it can be told associations, as in `causal@ekf`.
        is_yardstick: whether it is the optimum that estimates of its kind are compared with. It is told true
            noise and associations, as nobody else.
        is_bound: whether it is no estimator but what none can beat: a function of truth and recording.
        lag: steps of the window that its name asks for.
        title: its name as an optimum in figures.
        is_own: whether it is people's own: what it prints and raises is theirs.
        is_benched: whether `slamgauge bench` measures it unless it is told otherwise.
        look: of its curves; None takes a guest's.
    """

    name: str
    home: str = ""
    kind: Kind | None = "filtered"
    note: str = ""
    is_filter: bool = False
    is_graph: bool = False
    is_yardstick: bool = False
    is_bound: bool = False
    lag: int | None = None
    title: str = ""
    is_own: bool = False
    is_benched: bool = True
    look: Look | None = None

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
        name="ekf",
        home="slamgauge.ekf:ekf_slam",
        is_filter=True,
        look=Look("#CC3311", (0, (5, 1.2))),
    ),
    Entry(
        name="fej-ekf",
        home="slamgauge.ekf:fej_ekf",
        is_filter=True,
        look=Look("#33BBEE", (0, (3, 1, 1, 1, 1, 1))),
    ),
    Entry(
        name="oc-ekf",
        home="slamgauge.ekf:oc_ekf",
        is_filter=True,
        look=Look("#EE3377", (0, (6, 1, 1, 1, 3, 1))),
    ),
    Entry(
        name="iekf",
        home="slamgauge.ekf:iekf",
        is_filter=True,
        look=Look("#775522", (0, (9, 2))),
    ),
    Entry(
        name="riekf",
        home="slamgauge.ekf:riekf",
        is_filter=True,
        look=Look("#0077BB", (0, (4, 1, 1, 1))),
    ),
    Entry(
        name="riukf",
        home="slamgauge.ekf:riukf",
        note="right-invariant, with sigma points",
        is_benched=False,
        look=Look("#AA4499", (0, (2, 1, 5, 1))),
    ),
    Entry(
        name="robocentric-ekf",
        home="slamgauge.ekf:robocentric_ekf",
        note="map in the robot's frame",
        is_benched=False,
        look=Look("#117733", (0, (8, 1, 2, 1))),
    ),
    Entry(
        name=SLIDING_WINDOW,
        home="slamgauge.ekf:sliding_window",
        note=f"filter, the last 100 steps linearised anew; {SLIDING_WINDOW}-50: the last 50",
        is_benched=False,
        look=Look("#661100", (0, (5, 1, 1, 1, 1, 1))),
    ),
    Entry(
        name=FIXED_LAG,
        home="slamgauge.graph_baseline:fixed_lag",
        note=f"the last 20 steps smoothed; {FIXED_LAG}-5: the last 5",
        is_graph=True,
        is_benched=False,
    ),
    Entry(
        name="causal",
        home="slamgauge.graph_baseline:causal",
        note="causal optimum",
        is_graph=True,
        is_yardstick=True,
        title="causal optimum",
        look=Look("#CC9900", (0, (2, 1))),
    ),
    Entry(
        name="batch",
        home="slamgauge.graph_baseline:batch",
        kind="smoothed",
        note="hindsight",
        is_graph=True,
        is_yardstick=True,
        title="hindsight optimum",
        look=Look("#882288", (0, (7, 1, 1, 1, 1, 1))),
    ),
    Entry(
        name="robust-batch",
        home="slamgauge.graph_baseline:robust_batch",
        kind="smoothed",
        is_graph=True,
        is_benched=False,
    ),
)
REGISTRY = {entry.name: entry for entry in _ENTRIES}
BOUND, HINDSIGHT_BOUND = "bound", "hindsight-bound"
BOUNDS = {  # of studies: these need the truth, and many runs
    BOUND: Entry(
        name=BOUND,
        home="slamgauge.graph_baseline:causal_bound",
        note="of studies: what no estimator can beat, causal and in hindsight",
        is_bound=True,
        look=Look("#000000", (0, (1, 1))),
    ),
    HINDSIGHT_BOUND: Entry(
        name=HINDSIGHT_BOUND,
        home="slamgauge.graph_baseline:hindsight_bound",
        kind="smoothed",
        is_bound=True,
        look=Look("#777777", (0, (1, 2))),
    ),
}
BOUND_OF = {str(entry.kind): entry.name for entry in BOUNDS.values()}  # by the kind that they bound
FILTERS = tuple(entry.name for entry in _ENTRIES if entry.is_filter)
GRAPHS = tuple(entry.name for entry in _ENTRIES if entry.is_graph)
YARDSTICKS = {str(entry.kind): entry.name for entry in _ENTRIES if entry.is_yardstick}  # by the kind they judge
CAUSAL, HINDSIGHT = YARDSTICKS["filtered"], YARDSTICKS["smoothed"]
BENCHED = ",".join(entry.name for entry in _ENTRIES if entry.is_benched)
_HELPED = (*_ENTRIES, BOUNDS[BOUND])
HELP = (
    f"Comma-separated: {', '.join(f'{each.name} ({each.note})' if each.note else each.name for each in _HELPED)}; "
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
    if entry is not None and entry.is_graph and filter_name in FILTERS:
        return replace(entry, name=name, note="", is_yardstick=False, title="", look=None)
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


def is_yardstick(name: str) -> bool:
    """Whether a name, as `load_estimators` takes it, is that of an optimum."""
    return name in YARDSTICKS.values()
