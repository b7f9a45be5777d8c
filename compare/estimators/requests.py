"""Requested estimators, by name or address: picklable, and nothing is loaded yet."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Literal

from slamgauge.compare.estimators.addresses import Address, Noise, address, require_label
from slamgauge.compare.estimators.child import Limits
from slamgauge.compare.estimators.registry import BOUND, BOUNDS, HINDSIGHT_BOUND, entry_of, is_ours
from slamgauge.compare.estimators.sandbox import require_wall
from slamgauge.errors import UserError
from slamgauge.estimate import Estimator


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
    """User code at an address, which runs in a child process (`child`).

    Attributes:
        where: its address.
        noise: noise that it assumes.
        limits: its time, and whether it runs behind a wall.
        strict: whether filtered estimates are checked for use of the future (`causality_check`).
    """

    where: Address
    noise: Noise = "recording"
    limits: Limits = field(default_factory=Limits)
    strict: bool = False

    @property
    def key(self) -> str:
        """Key of its results in stores, with the digest of its folder: edited code is another estimator."""
        settings = [*(["noise=file"] if self.noise == "file" else []), *(["strict"] if self.strict else [])]
        return " ".join([self.label, self.where.attribute, self.where.digest[:16], *settings])


@dataclass(frozen=True)
class GivenCallable(_User):
    """A callable given in Python, which runs in this process."""

    call: Estimator

    @property
    def key(self) -> str:
        """Key of its results in stores, with the digest of the file that defines it."""
        return f"{self.label} {_digest_of(self.call)[:16]}"


Asked = BuiltIn | UserCode | GivenCallable
Chosen = Sequence[str | Asked] | Mapping[str, str | Estimator]  # names and addresses; or these by label


def ask(chosen: Chosen) -> list[Asked]:
    """Parse estimators: names, addresses `[LABEL=]FILE.py:callable`, or a mapping from labels to these or callables.

    `bound` means both bounds, causal and hindsight. The folder of user code is read now: later edits do not change the
    request.

    Raises:
        UserError: an unknown name, an address of a wrong form, or two estimators with one label.
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


def with_limits(asked: Sequence[Asked], limits: Limits, *, strict: bool = False) -> list[Asked]:
    """Set the limits of user code among the requests.

    Raises:
        UserError: it must run behind a wall, and this system has none.
    """
    is_there = any(isinstance(each, UserCode) for each in asked)
    if is_there and limits.is_walled:
        require_wall()
    return [replace(each, limits=limits, strict=strict) if isinstance(each, UserCode) else each for each in asked]


def with_noise(asked: Sequence[Asked], noise: Noise | Literal["both"]) -> list[Asked]:
    """Set the noise that user code assumes; `both` requests each with its own noise, too."""
    found: list[Asked] = []
    for each in asked:
        if not isinstance(each, UserCode) or noise == "recording":
            found.append(each)
            continue
        if noise == "both":
            found.append(each)
        label = f"{each.label} (own noise)" if noise == "both" else each.label
        found.append(replace(each, label=label, noise="file"))
    return found


def labels_among(names: Sequence[str], among: Collection[str], otherwise: str) -> list[str]:
    """Return the labels of estimators that are given by label or address.

    Raises:
        UserError: a label is not `among` the available ones; the message contains `otherwise`.
    """
    labels = [name if name in among or ":" not in name else address(name).label for name in names]
    for name, label in zip(names, labels, strict=True):
        if label not in among:
            raise UserError(f"estimator {name!r}: {otherwise}; choose from {', '.join(among)}")
    return labels


def _asked(label: str, what: str | Estimator) -> Asked:
    if not isinstance(what, str):
        require_label(label, label)
        return GivenCallable(label, what)
    if not set(":=/\\") & set(what) and not what.endswith(".py"):
        return BuiltIn(label or what, entry_of(what).name)
    where = address(what)
    return UserCode(label or where.label, where)


def _digest_of(call: Estimator) -> str:
    """Return the SHA-256 of a callable's name and of the file that defines it, if there is one."""
    module = inspect.getmodule(call)
    file = getattr(module, "__file__", None)
    content = Path(file).read_bytes() if file is not None and Path(file).is_file() else b""
    name = getattr(call, "__qualname__", type(call).__qualname__)
    return hashlib.sha256(name.encode() + content).hexdigest()
