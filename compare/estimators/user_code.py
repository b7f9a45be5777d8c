"""People's own estimators: `[LABEL=]FILE.py:callable` or `[LABEL=]package.module:callable`."""

from __future__ import annotations

import importlib
import os
import sys
import traceback
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from slamgauge import errors
from slamgauge.compare.estimators.headless_import import without_windows
from slamgauge.compare.estimators.private_import import PrivateFolder, public
from slamgauge.compare.estimators.sources import Sources, sources_of
from slamgauge.compare.storage.safe_names import LONGEST
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

Callee = Callable[..., Any]

FORM = "write FILE.py:callable or module:callable, for example my_filter.py:estimate"
SILENT = (Path(errors.__file__).parent, Path(__file__).parent)  # ours, which an error passes through


class Address(NamedTuple):
    """Where an estimator is: `place` is a file or a module, `label` the name that results carry.

    `sources` are those of a file, or of a module of the current folder; None of what is installed, or not there.
    `strangers` are modules beside it that are other people's: they do not hide what is installed under their names.
    """

    text: str
    label: str
    place: str
    attribute: str
    sources: Sources | None = None
    strangers: tuple[str, ...] = ()


def address(text: str) -> Address:
    """The parts of `[LABEL=]PLACE:callable`; without a label the text itself is it, a file's folders dropped.

    Raises:
        UserError: it has another form.
    """
    place, _, attribute = text.rpartition(":")
    label, equals, rest = place.partition("=")
    if equals and not os.path.isfile(place):  # noqa: PTH113 a label may be longer than a path can be
        place = rest
    else:
        label = f"{Path(place).name}:{attribute}"
    if not place or not attribute:
        raise UserError(f"estimator {text!r}: {FORM}")
    if place.endswith(".py") and "." in Path(place).stem:
        raise UserError(f"estimator {text!r}: no Python module can have a dot in its name; rename the file")
    require_label(label, text)
    return Address(text, label, place, attribute, _sources(place))


def require_label(label: str, text: str) -> None:
    """Refuse a label that cannot name a file; `text` is what was asked for."""
    is_short = len(label.encode(errors="replace")) <= LONGEST
    if not label.strip() or set("/\\") & set(label) or not label.isprintable() or not is_short:
        remedy = "give a short word without slashes, and with no blanks but plain ones"
        raise UserError(f"estimator {text!r}: label {label!r} names files of results; {remedy}")


def _sources(place: str) -> Sources | None:
    path = Path(place)
    if place.endswith(".py"):
        return sources_of(path.parent, path.stem) if path.is_file() else None
    return sources_of(Path.cwd(), place) if PrivateFolder(Path.cwd()).owns(place) else None


class OwnCodeError(UserError):
    """What people's own code does that its form does not allow, said by the adapter that has noticed it."""


def load_own_module(where: Address) -> ModuleType:
    """Load the module afresh, in which the callable stands. THIS RUNS THAT CODE; what it prints goes to standard error.

    It opens no windows, and may call `exit()` once the callable is defined. A file's neighbours are its own to import;
    a module is looked up in the current folder, then among what is installed.

    Raises:
        UserError: it is not there, cannot be loaded, or is no callable.
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
    """`load_own_module`, whatever it defines; an address without an attribute allows it an exit anywhere.

    Raises:
        UserError: it is not there, or cannot be loaded.
    """
    try:
        with redirect_stdout(sys.stderr), without_windows():
            return _module(where)
    except (Exception, SystemExit) as error:
        if isinstance(error, _MissingError):
            raise UserError(f"estimator {where.text}: no file {where.place!r} is found; check the path") from None
        if isinstance(error, ModuleNotFoundError) and _is_asked_for(error.name, where.place):
            missing, remedy = public(error.name or ""), "run in its folder or install it, or give its file"
            raise UserError(f"estimator {where.text}: no module {missing!r} is found; {remedy}") from None
        raise UserError(f"estimator {where.text}: cannot be loaded, {where_it_broke(error)}") from error


def _module(where: Address) -> ModuleType:
    if where.sources is None:
        if where.place.endswith(".py"):
            raise _MissingError(where.place)
        return importlib.import_module(where.place)
    folder = PrivateFolder(where.sources.place(), where.strangers)
    module = folder.load(where.sources.module)
    left = folder.exits.get(module.__name__)
    if left is not None and where.attribute and not hasattr(module, where.attribute):
        raise left
    return module


class _MissingError(Exception):
    """A file that is not there."""


def _is_asked_for(missing: str | None, place: str) -> bool:
    """Whether the missing module is the one that was asked for, not one that it imports."""
    return missing is not None and f"{place}.".startswith(f"{public(missing)}.")


def reason_of(error: BaseException) -> str:
    """Why people's code gave no estimate, in one line."""
    return str(error) if isinstance(error, OwnCodeError) else where_it_broke(error)


def where_it_broke(error: BaseException) -> str:
    """One line: what was raised, and the last line of the user's code, or of what it called, that it passed through."""
    what = f"it raised {type(error).__name__}: {' '.join(public(str(error)).split()) or '(no message)'}"
    if not isinstance(error, SyntaxError):  # its message names the line
        frames = traceback.extract_tb(error.__traceback__)
        frames = [frame for frame in frames if frame.filename != importlib.__file__]
        frames = [frame for frame in frames if Path(frame.filename).parent not in SILENT]
        frames = [frame for frame in frames if not frame.filename.startswith("<")]
        what += "".join(f" ({Path(frame.filename).name}, line {frame.lineno})" for frame in frames[-1:])
    return f"{what}; mend it and run again"
