"""Estimators by name: those that come with slamgauge, and people's own."""

from __future__ import annotations

import importlib
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import nullcontext, redirect_stdout
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import cast

import slamgauge
from slamgauge.compare.scenarios.schema import Association, Beginning, Delayed, Fis, InverseDepth
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.recording import Recording

# name: module and attribute, imported when asked for
SHIPPED = {
    "dead-reckoning": ("slamgauge.ekf", "dead_reckoning"),
    "ekf": ("slamgauge.ekf", "ekf"),
    "fej-ekf": ("slamgauge.ekf", "fej_ekf"),
    "iekf": ("slamgauge.ekf", "iekf"),
    "riekf": ("slamgauge.ekf", "riekf"),
    "isam2": ("slamgauge.graph_baseline", "isam2"),
    "batch": ("slamgauge.graph_baseline", "batch"),
    "robust-batch": ("slamgauge.graph_baseline", "robust_batch"),
}
FILTERS = ("ekf", "fej-ekf", "iekf", "riekf")
GRAPHS = ("isam2", "batch", "robust-batch")
VOCABULARY = Path(slamgauge.__file__).parent  # whose constructors check what people make
UNDER = "@"  # isam2@ekf: isam2 under the associations that ekf makes


def load_estimators(
    names: Sequence[str],
    own: Sequence[str] = (),
    association: Association | None = None,
    beginning: Beginning | None = None,
    frames: int = 0,
) -> dict[str, Estimator]:
    """Estimators by the name that results carry.

    Args:
        names: shipped names; `isam2@ekf` is isam2 under the associations that ekf makes, and so for every graph
            and filter.
        own: import paths `module:attribute`; this loads and runs the code found there, with the current
            folder searched first.
        association: how filters associate a recording without ids; theirs by default is the nearest neighbour at
            gate 9. With `method` known, too: there they have ids.
        beginning: how filters begin landmarks where the recording has bearings alone.
        frames: at how many steps filters keep their map, for pictures.

    Raises:
        UserError: an unknown name, or an import path that leads to no callable.
    """
    estimators: dict[str, Estimator] = {}
    for name in names:
        graph, under, filter_name = name.partition(UNDER)
        estimator = _shipped(graph, association, beginning, frames)
        if under:
            if graph not in GRAPHS or filter_name not in FILTERS:
                remedy = f"write GRAPH@FILTER with one of {', '.join(GRAPHS)} and one of {', '.join(FILTERS)}"
                raise UserError(f"estimator {name!r} is not known; {remedy}")
            estimator = _under_associations(estimator, _shipped(filter_name, association, beginning))
        estimators[name] = estimator
    for path in own:
        estimators[path] = _import_estimator(path)
    return estimators


def _shipped(
    name: str, association: Association | None, beginning: Beginning | None, frames: int = 0
) -> Callable[..., Estimate]:
    if name not in SHIPPED:
        near = get_close_matches(name, SHIPPED, n=1)
        remedy = f"did you mean {near[0]}?" if near else f"use {', '.join(SHIPPED)}"
        raise UserError(f"estimator {name!r} is not known; {remedy}")
    module, attribute = SHIPPED[name]
    estimator = getattr(importlib.import_module(module), attribute)
    return partial(estimator, **_settings(association, beginning, frames)) if name in FILTERS else estimator


def _settings(association: Association | None, beginning: Beginning | None, frames: int) -> dict[str, object]:
    """A scenario's settings as a filter takes them."""
    import slamgauge.ekf as ekf

    settings: dict[str, object] = {"frames": frames} if frames else {}
    if association is not None and association.method != "known":
        managed = association.method == "jcbb" if association.map_management is None else association.map_management
        management = ekf.MapManagement() if managed else None
        settings["association"] = ekf.Association(association.method, association.gate, management)
    if beginning is not None:
        kinds = {Fis: ekf.Rays, InverseDepth: ekf.InverseDepth, Delayed: ekf.Delayed}
        settings["initialisation"] = kinds[type(beginning)](**beginning.model_dump())
    return settings


def _under_associations(graph: Callable[..., Estimate], slam: Callable[..., Estimate]) -> Estimator:
    """The graph with the associations that a filter makes of the same recording, as they stand at its end."""
    return lambda recording: graph(recording, slam(recording).association)


def _import_estimator(path: str) -> Estimator:
    module_name, _, attribute = path.partition(":")
    if not module_name or not attribute:
        raise UserError(f"estimator {path!r}: write module:attribute, for example my_filter:estimate")
    if str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))
    try:
        with redirect_stdout(sys.stderr):
            module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module_name}.".startswith(f"{error.name}."):  # a module that theirs imports
            raise UserError(f"estimator {path}: cannot be loaded, {_where_it_broke(error)}") from error
        remedy = "run in its folder or install it, and write module:attribute"
        raise UserError(f"estimator {path}: no module {error.name!r} is found; {remedy}") from None
    except (Exception, SystemExit) as error:
        raise UserError(f"estimator {path}: cannot be loaded, {_where_it_broke(error)}") from error
    if not hasattr(module, attribute):
        near = get_close_matches(attribute, vars(module), n=1)
        remedy = f"did you mean {near[0]}?" if near else "name a callable Recording -> Estimate of that module"
        raise UserError(f"estimator {path}: {module_name} has no {attribute!r}; {remedy}")
    estimator = getattr(module, attribute)
    if not callable(estimator):
        raise UserError(f"estimator {path}: is a {type(estimator).__name__}; give a callable Recording -> Estimate")
    return estimator  # pyright: ignore[reportReturnType]


def run_estimator(name: str, estimator: Estimator, recording: Recording) -> tuple[Estimate, float]:
    """The estimate, checked against the recording, and the seconds that it took.

    Raises:
        UserError: the estimator raised, or what it returned does not fit the recording.
    """
    start = perf_counter()
    try:
        # standard output is for results; ours are silent, and threads of a study must not redirect it
        with nullcontext() if _is_shipped(name) else redirect_stdout(sys.stderr):
            estimate = cast("object", estimator(recording))
    except (Exception, SystemExit) as error:
        if _is_shipped(name) and not isinstance(error, UserError):
            raise
        reason = str(error) if _is_shipped(name) else _where_it_broke(error)
        raise UserError(f"estimator {name}: {reason}") from error
    seconds = perf_counter() - start
    if not isinstance(estimate, Estimate):
        raise UserError(f"estimator {name}: returned a {type(estimate).__name__}; return a slamgauge.Estimate")
    if len(estimate.poses) != recording.steps + 1:
        raise UserError(
            f"estimator {name}: returned {len(estimate.poses)} poses; "
            f"return {recording.steps + 1}, one for the start and one for every step"
        )
    if estimate.association is not None and len(estimate.association) != len(recording.observation):
        raise UserError(
            f"estimator {name}: association has {len(estimate.association)} entries; "
            f"return {len(recording.observation)}, one for every observation"
        )
    return estimate, seconds


def _is_shipped(name: str) -> bool:
    return name.partition(UNDER)[0] in SHIPPED


def _where_it_broke(error: BaseException) -> str:
    """One line: what was raised, and the last line of the user's code, or of what it called, that it passed through."""
    what = f"it raised {type(error).__name__}: {' '.join(str(error).split()) or '(no message)'}"
    if not isinstance(error, SyntaxError):  # its message names the line
        frames = traceback.extract_tb(error.__traceback__)
        frames = [frame for frame in frames if frame.filename not in (__file__, importlib.__file__)]
        frames = [frame for frame in frames if Path(frame.filename).parent != VOCABULARY]
        frames = [frame for frame in frames if not frame.filename.startswith("<")]
        what += "".join(f" ({Path(frame.filename).name}, line {frame.lineno})" for frame in frames[-1:])
    return f"{what}; mend it and run again"
