"""Requested estimators, by name, address or callable: picklable, and nothing is loaded yet.

User code has an address, `[LABEL=]FILE.py:callable` or `[LABEL=]package.module:callable`.
"""

from __future__ import annotations

import hashlib
import inspect
import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Literal, NamedTuple

from slamgauge.compare.estimators.code_folder import CodeFolder, installed_digest, read_folder
from slamgauge.compare.estimators.forms.signatures import Noise
from slamgauge.compare.estimators.registry import BOUND, BOUNDS, HINDSIGHT_BOUND, entry_of, is_ours
from slamgauge.compare.estimators.sandbox import require_wall
from slamgauge.compare.storage.result_files import LONGEST
from slamgauge.errors import UserError
from slamgauge.estimate import Estimator


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


class Limits(NamedTuple):
    """Limits of user code: the largest time of a run and of loading [s], and whether it runs behind a wall."""

    seconds: float = 600.0
    is_walled: bool = False


@dataclass(frozen=True)
class BuiltIn:
    """A built-in estimator: `label` names its rows and files of results, `name` is its name in the registry."""

    label: str
    name: str

    @property
    def key(self) -> str:
        """Key of its results in stores."""
        return self.label

    @property
    def is_bound(self) -> bool:
        """Whether it is a bound, which needs the truth."""
        return self.name in BOUNDS

    @property
    def is_told(self) -> bool:
        """Whether it receives true noise and associations: a yardstick of the others."""
        return self.is_bound or entry_of(self.name).is_informed


@dataclass(frozen=True)
class _User:
    """Code of a user, which receives the recording only."""

    label: str
    is_bound: ClassVar[bool] = False
    is_told: ClassVar[bool] = False


@dataclass(frozen=True)
class UserCode(_User):
    """User code at an address, which runs in a child process, and the noise that it assumes.

    If `strict`, filtered estimates are checked for use of the future (`loading`).
    """

    where: Address
    noise: Noise = "recording"
    limits: Limits = field(default_factory=Limits)
    strict: bool = False

    @property
    def key(self) -> str:
        """Key of its results in stores, with the digest of its folder: edited code is another estimator."""
        where = self.where
        digest = where.installed if where.code is None else where.code.digest
        settings = [*(["noise=file"] if self.noise == "file" else []), *(["strict"] if self.strict else [])]
        return " ".join([self.label, where.attribute, digest[:16], *settings])


@dataclass(frozen=True)
class GivenCallable(_User):
    """A callable given in Python, which runs in this process."""

    call: Estimator

    @property
    def key(self) -> str:
        """Key of its results in stores, with the digest of its name and of the file that defines it, if that is one."""
        file = getattr(inspect.getmodule(self.call), "__file__", None)
        content = Path(file).read_bytes() if file is not None and Path(file).is_file() else b""
        name = getattr(self.call, "__qualname__", type(self.call).__qualname__)
        return f"{self.label} {hashlib.sha256(name.encode() + content).hexdigest()[:16]}"


Asked = BuiltIn | UserCode | GivenCallable
Chosen = Sequence[str | Asked] | Mapping[str, str | Estimator]  # names and addresses; or these by label


def ask(chosen: Chosen) -> list[Asked]:
    """Parse estimators: names, addresses `[LABEL=]FILE.py:callable`, or a mapping from labels to these or callables.

    `bound` means both bounds, causal and hindsight. The folder of user code is read now: later edits do not change the
    request. Unknown names, addresses of a wrong form and repeated labels are refused.
    """
    if isinstance(chosen, str):
        raise UserError(f"estimators: {chosen!r} is one text; give a list of names, or a dict by labels")
    if isinstance(chosen, Mapping):
        asked = [_asked(label, what) for label, what in chosen.items()]
    else:
        both = BOUNDS if HINDSIGHT_BOUND not in chosen else [BOUND]
        chosen = [name for each in chosen for name in (both if each == BOUND else [each])]
        asked = [_asked("", each) if isinstance(each, str) else each for each in chosen]
    labels = [each.label for each in asked]
    for each in asked:
        is_taken = not isinstance(each, BuiltIn) and is_ours(each.label)
        if is_taken or labels.count(each.label) > 1:
            text = each.where.text if isinstance(each, UserCode) else each.label
            why = "is a built-in estimator" if is_taken else "is given twice"
            raise UserError(f"estimator {text!r}: {each.label} {why}; write another LABEL= in front")
    return asked


def _asked(label: str, what: str | Estimator) -> Asked:
    if not isinstance(what, str):
        _require_label(label, label)
        return GivenCallable(label, what)
    if not set(":=/\\") & set(what) and not what.endswith(".py"):
        return BuiltIn(label or what, entry_of(what).name)
    where = address(what)
    return UserCode(label or where.label, where)


def with_limits(asked: Sequence[Asked], limits: Limits, *, strict: bool = False) -> list[Asked]:
    """Set the limits of user code among the requests, or refuse it if it needs a wall and this system has none."""
    if limits.is_walled and any(isinstance(each, UserCode) for each in asked):
        require_wall()
    return [replace(each, limits=limits, strict=strict) if isinstance(each, UserCode) else each for each in asked]


def with_noise(asked: Sequence[Asked], noise: Noise | Literal["both"]) -> list[Asked]:
    """Set the noise that user code assumes; `both` requests each with its own noise, too."""
    found: list[Asked] = []
    for each in asked:
        if not isinstance(each, UserCode) or noise != "file":
            found.append(each)
        if isinstance(each, UserCode) and noise != "recording":
            label = f"{each.label} (own noise)" if noise == "both" else each.label
            found.append(replace(each, label=label, noise="file"))
    return found


def labels_among(names: Sequence[str], among: Collection[str], otherwise: str) -> list[str]:
    """Return the labels of estimators that are given by label or address; labels not `among` others are refused."""
    labels = [name if name in among or ":" not in name else address(name).label for name in names]
    for name, label in zip(names, labels, strict=True):
        if label not in among:
            raise UserError(f"estimator {name!r}: {otherwise}; choose from {', '.join(among)}")
    return labels


def address(text: str) -> Address:
    """Parse `[LABEL=]PLACE:callable` or `[LABEL=]FILE.py`; without a label it is the text without folders.

    The folder of the code is read now: later edits do not change the request.
    """
    place, _, attribute = (text, "", "") if text.endswith(".py") else text.rpartition(":")
    label, equals, rest = place.partition("=")
    if equals and not os.path.isfile(place):  # noqa: PTH113 a label may be longer than a path can be
        place = rest
    else:
        label = f"{Path(place).name}:{attribute}".rstrip(":")
    if not place or not (attribute or text.endswith(".py")):
        remedy = "write FILE.py:callable or module:callable, for example my_filter.py:estimate"
        raise UserError(f"estimator {text!r}: {remedy}")
    if place.endswith(".py") and "." in Path(place).stem:
        raise UserError(f"estimator {text!r}: no Python module can have a dot in its name; rename the file")
    _require_label(label, text)
    if place.endswith(".py"):
        if not Path(place).is_file():
            raise UserError(f"estimator {text}: no file {place!r} is found; check the path")
        return Address(text, label, place, attribute, read_folder(Path(place).parent, Path(place).stem))
    head = Path.cwd() / place.partition(".")[0]
    if head.name and (head.with_name(f"{head.name}.py").is_file() or (head / "__init__.py").is_file()):
        return Address(text, label, place, attribute, read_folder(Path.cwd(), place))
    return Address(text, label, place, attribute, None, installed_digest(place))


def _require_label(label: str, text: str) -> None:
    """Refuse a label that cannot name a file; error messages quote `text`, the estimator as the user wrote it."""
    is_short = len(label.encode(errors="replace")) <= LONGEST
    if not label.strip() or set("/\\") & set(label) or not label.isprintable() or not is_short:
        remedy = "give a short word without slashes, and with no blanks but plain ones"
        raise UserError(f"estimator {text!r}: label {label!r} names files of results; {remedy}")
