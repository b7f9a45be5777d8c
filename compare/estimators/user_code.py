"""User code by its address `[LABEL=]FILE.py:callable` or `[LABEL=]module:callable`, and its errors in one line."""

from __future__ import annotations

import importlib
import os
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, NamedTuple

from slamgauge import errors
from slamgauge.compare.estimators.captured_output import stdout_to_stderr
from slamgauge.compare.estimators.no_windows import without_windows
from slamgauge.compare.estimators.private_import import PrivateFolder, public
from slamgauge.compare.estimators.sources import LIBRARIES, Sources, installed_digest, sources_of
from slamgauge.compare.storage.safe_names import LONGEST
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

Callee = Callable[..., Any]

ESTIMATE = "estimate"  # name of the callable that is looked for first
Noise = Literal["recording", "file"]

MOST = 1000  # characters of an error's text
FORM = "write FILE.py:callable or module:callable, for example my_filter.py:estimate"
SILENT = (
    Path(errors.__file__).parent,
    Path(__file__).parent,
    Path(__file__).parent / "forms",
)  # folders of slamgauge that an error passes through


class Address(NamedTuple):
    """Place of an estimator in user code.

    Attributes:
        text: the address as the user wrote it.
        label: name of its results.
        place: file or module.
        attribute: name of the callable; empty if it must be found.
        sources: sources of a file, or of a module of the current folder; None for installed or missing modules.
        strangers: neighbours that belong to other people: an installed module of the same name comes first.
        noise: assumed noise: that of the recording, or that of the file, for forms that can use both.
        form: name of the form of the code (`adapters.FORMS`); empty if it follows from the code.
        installed: `installed_digest` of a module without `sources`.
    """

    text: str
    label: str
    place: str
    attribute: str
    sources: Sources | None = None
    strangers: tuple[str, ...] = ()
    noise: Noise = "recording"
    form: str = ""
    installed: str = ""


def address(text: str) -> Address:
    """Parse `[LABEL=]PLACE:callable` or `[LABEL=]FILE.py`; without a label it is the text without folders.

    Raises:
        UserError: the text has another form.
    """
    place, _, attribute = (text, "", "") if text.endswith(".py") else text.rpartition(":")
    label, equals, rest = place.partition("=")
    if equals and not os.path.isfile(place):  # noqa: PTH113 a label may be longer than a path can be
        place = rest
    else:
        label = f"{Path(place).name}:{attribute}".rstrip(":")
    if not place or not (attribute or text.endswith(".py")):
        raise UserError(f"estimator {text!r}: {FORM}")
    if place.endswith(".py") and "." in Path(place).stem:
        raise UserError(f"estimator {text!r}: no Python module can have a dot in its name; rename the file")
    require_label(label, text)
    sources = _sources(place)
    installed = "" if sources or place.endswith(".py") else installed_digest(place)
    return Address(text, label, place, attribute, sources, installed=installed)


def require_label(label: str, text: str) -> None:
    """Refuse a label that cannot name a file; error messages quote `text`, the estimator as the user wrote it."""
    is_short = len(label.encode(errors="replace")) <= LONGEST
    if not label.strip() or set("/\\") & set(label) or not label.isprintable() or not is_short:
        remedy = "give a short word without slashes, and with no blanks but plain ones"
        raise UserError(f"estimator {text!r}: label {label!r} names files of results; {remedy}")


def _sources(place: str) -> Sources | None:
    path = Path(place)
    if place.endswith(".py"):
        return sources_of(path.parent, path.stem) if path.is_file() else None
    return sources_of(Path.cwd(), place) if PrivateFolder(Path.cwd()).owns(place) else None


class UserCodeError(UserError):
    """User code did what its form does not allow; the message is complete."""


class OverdueError(UserCodeError):
    """User code exceeded its timeout."""


def load_callable_module(where: Address) -> ModuleType:
    """Load the module that defines the callable afresh. THIS RUNS USER CODE; its prints go to standard error.

    No figure opens a window, and the module may call `exit()` after it has defined the callable. A file finds its
    neighbours first; a module is looked for in the current folder, then among the installed ones.

    Raises:
        UserError: the module does not exist, cannot be loaded, or has no such callable.
    """
    module = load_whole_module(where)
    if not hasattr(module, where.attribute):
        remedy = did_you_mean(where.attribute, vars(module), "name a callable Recording -> Estimate of that module")
        raise UserError(f"estimator {where.text}: {where.place} has no {where.attribute!r}; {remedy}")
    estimator = getattr(module, where.attribute)
    if not callable(estimator):
        kind = type(estimator).__name__
        raise UserError(f"estimator {where.text}: is a {kind}; give a callable Recording -> Estimate")
    return module


def load_whole_module(where: Address) -> ModuleType:
    """Load a module as `load_callable_module` does, whatever it defines.

    If the address has no attribute, the module may call `exit()` anywhere.

    Raises:
        UserError: the module does not exist or cannot be loaded.
    """
    if where.sources is None and where.place.endswith(".py"):
        raise UserError(f"estimator {where.text}: no file {where.place!r} is found; check the path")
    try:
        with stdout_to_stderr(), without_windows():
            if where.sources is None:
                return importlib.import_module(where.place)
            folder, module = _loaded(where, where.sources)
            exited = folder.exits.get(module.__name__)
            if exited is not None and where.attribute and not hasattr(module, where.attribute):
                raise exited  # noqa: TRY301 reported like an error of the module
            return module
    except (Exception, SystemExit) as error:
        missing = public(error.name or "") if isinstance(error, ModuleNotFoundError) else ""
        if missing and f"{where.place}.".startswith(f"{missing}."):  # not one that the module imports
            remedy = "run in its folder or install it, or give its file"
            raise UserError(f"estimator {where.text}: no module {missing!r} is found; {remedy}") from None
        raise UserError(f"estimator {where.text}: cannot be loaded, {where_it_broke(error)}") from error


def _loaded(where: Address, sources: Sources) -> tuple[PrivateFolder, ModuleType]:
    """Load a module without its simulation, or whole if it does not define the callable otherwise."""
    place, wanted = sources.place(), {where.attribute or ESTIMATE}
    with suppress(Exception):
        folder = PrivateFolder(place, where.strangers, wanted)
        module = folder.load(sources.module)
        if not where.attribute or hasattr(module, where.attribute):
            return folder, module
    folder = PrivateFolder(place, where.strangers)
    return folder, folder.load(sources.module)


def reason_of(error: BaseException) -> str:
    """Return in one line why user code returned no estimate."""
    return str(error) if isinstance(error, UserCodeError) else where_it_broke(error)


def where_it_broke(error: BaseException) -> str:
    """Return the error in one line, with the last line of the user's files that it passed through."""
    what = f"it raised {type(error).__name__}: {_message_of(error)}"
    if not isinstance(error, SyntaxError):  # its message names the line
        frames = [frame for frame in user_frames(error) if frame.filename != importlib.__file__]
        frames = [frame for frame in frames if not frame.filename.startswith("<")]
        frames = [frame for frame in frames if not frame.filename.startswith(LIBRARIES)] or frames
        what += "".join(f" ({Path(frame.filename).name}, line {frame.lineno})" for frame in frames[-1:])
    remedy = "mend it and run again"
    if isinstance(error, FileNotFoundError) and isinstance(error.filename, str):
        name = Path(error.filename).name
        remedy = f"read {name} below `if __name__ == '__main__':`, or open Path(__file__).parent / {name!r}"
    return f"{what}; {remedy}"


def _message_of(error: BaseException) -> str:
    """Return the text of an error in one line, at most `MOST` characters; user code may have written its `__str__`."""
    try:
        text = str(error)[:MOST]
    except Exception as another:  # noqa: BLE001 user code may raise anything
        return f"(no message: its text raised {type(another).__name__})"
    return " ".join(public(text).split()) or "(no message)"


def user_frames(error: BaseException) -> list[traceback.FrameSummary]:
    """Return the frames of an error outside the folders of slamgauge that run user code."""
    frames = traceback.extract_tb(error.__traceback__)
    return [frame for frame in frames if Path(frame.filename).parent not in SILENT]
