"""Addresses of user code: `[LABEL=]FILE.py:callable` and `[LABEL=]package.module:callable`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal, NamedTuple

from slamgauge.compare.estimators.code_folder import CodeFolder, installed_digest, read_folder
from slamgauge.compare.storage.safe_names import LONGEST
from slamgauge.errors import UserError

Noise = Literal["recording", "file"]  # the noise that user code assumes
EXAMPLE = "write FILE.py:callable or module:callable, for example my_filter.py:estimate"


class Address(NamedTuple):
    """Place of an estimator in user code.

    Attributes:
        text: the address as the user wrote it.
        label: name of its results.
        place: file or module.
        attribute: name of the callable; empty if it must be found.
        code: the folder of a file, or of a module of the current folder; None for an installed module.
        installed: `installed_digest` of a module without `code`.
    """

    text: str
    label: str
    place: str
    attribute: str
    code: CodeFolder | None = None
    installed: str = ""

    @property
    def digest(self) -> str:
        """Digest of its code: edited code is another estimator."""
        return self.installed if self.code is None else self.code.digest


def address(text: str) -> Address:
    """Parse `[LABEL=]PLACE:callable` or `[LABEL=]FILE.py`; without a label it is the text without folders.

    The folder of the code is read now: later edits do not change the request.

    Raises:
        UserError: the text has another form, or the file does not exist.
    """
    place, _, attribute = (text, "", "") if text.endswith(".py") else text.rpartition(":")
    label, equals, rest = place.partition("=")
    if equals and not os.path.isfile(place):  # noqa: PTH113 a label may be longer than a path can be
        place = rest
    else:
        label = f"{Path(place).name}:{attribute}".rstrip(":")
    if not place or not (attribute or text.endswith(".py")):
        raise UserError(f"estimator {text!r}: {EXAMPLE}")
    if place.endswith(".py") and "." in Path(place).stem:
        raise UserError(f"estimator {text!r}: no Python module can have a dot in its name; rename the file")
    require_label(label, text)
    code = _code_at(place)
    if code is None and place.endswith(".py"):
        raise UserError(f"estimator {text}: no file {place!r} is found; check the path")
    return Address(text, label, place, attribute, code, "" if code else installed_digest(place))


def _code_at(place: str) -> CodeFolder | None:
    if place.endswith(".py"):
        path = Path(place)
        return read_folder(path.parent, path.stem) if path.is_file() else None
    head = Path.cwd() / place.partition(".")[0]
    is_here = head.with_name(f"{head.name}.py").is_file() or (head / "__init__.py").is_file()
    return read_folder(Path.cwd(), place) if is_here and head.name else None


def require_label(label: str, text: str) -> None:
    """Refuse a label that cannot name a file; error messages quote `text`, the estimator as the user wrote it."""
    is_short = len(label.encode(errors="replace")) <= LONGEST
    if not label.strip() or set("/\\") & set(label) or not label.isprintable() or not is_short:
        remedy = "give a short word without slashes, and with no blanks but plain ones"
        raise UserError(f"estimator {text!r}: label {label!r} names files of results; {remedy}")
