"""Requested estimators, by name or address: picklable, and nothing is loaded yet."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from slamgauge.compare.estimators.registry import BOUND, BOUNDS, HINDSIGHT_BOUND, entry_of, is_ours
from slamgauge.compare.estimators.user_code import Address, Noise, address, require_label
from slamgauge.errors import UserError
from slamgauge.estimate import Estimator


@dataclass(frozen=True)
class Isolation:
    """Settings of user code in a child process (`isolated_process`).

    Attributes:
        timeout: largest time of a run [s].
        strict: whether filtered estimates are checked for use of the future (`causality_check`).
        unconfined: whether it runs without a wall (`wall`).
    """

    timeout: float
    strict: bool
    unconfined: bool = False


@dataclass(frozen=True)
class Asked:
    """A requested estimator.

    Attributes:
        label: name of its rows and files of results.
        name: name in the registry, for built-in estimators.
        where: address of user code.
        call: callable given in Python.
        isolation: how user code is isolated; None runs it in this process.
    """

    label: str
    name: str = ""
    where: Address | None = None
    call: Estimator | None = None
    isolation: Isolation | None = None

    @property
    def is_bound(self) -> bool:
        """Whether it is a bound, which needs the truth."""
        return self.name in BOUNDS

    @property
    def is_told(self) -> bool:
        """Whether it receives true noise and associations: a yardstick of the others."""
        return bool(self.name) and (self.is_bound or entry_of(self.name).is_informed)

    @property
    def key(self) -> str:
        """Key of its results in stores, with the digest of user code: edited code is another estimator."""
        if self.where is not None:
            digest = self.where.installed if self.where.sources is None else self.where.sources.digest
            apart = "" if self.isolation is None else f" {self.isolation.timeout:g}s strict={self.isolation.strict}"
            chosen = [text for text in (self.where.form, self.where.noise) if text not in ("", "recording")]
            return " ".join([self.label, self.where.attribute, digest[:16], *chosen]) + apart
        if self.call is not None:
            return f"{self.label} {_digest_of(self.call)[:16]}"
        return self.label


Chosen = Sequence[str | Asked] | Mapping[str, str | Estimator]  # names and addresses; or these by label


def ask(chosen: Chosen) -> list[Asked]:
    """Parse estimators: names, addresses `[LABEL=]FILE.py:callable`, or a mapping from labels to these or callables.

    `bound` means both bounds, causal and hindsight. Sources of user code are read now: later edits of the file do not
    change the request.

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
        asked = [each if isinstance(each, Asked) else _asked("", each) for each in chosen]
    labels = [each.label for each in asked]
    for each in asked:
        is_taken = not each.name and is_ours(each.label)
        if is_taken or labels.count(each.label) > 1:
            text = each.label if each.where is None else each.where.text
            why = "is a built-in estimator" if is_taken else "is given twice"
            raise UserError(f"estimator {text!r}: {each.label} {why}; write another LABEL= in front")
    return asked


def isolated(asked: Sequence[Asked], isolation: Isolation | None) -> list[Asked]:
    """Isolate user code among the requests; built-in estimators and callables of this process are unchanged.

    Raises:
        UserError: this system cannot isolate user code, or not behind a wall.
    """
    from slamgauge.compare.estimators.isolated_process import require_isolation

    if isolation is not None and any(each.where is not None for each in asked):
        remedy = "leave out --strict and --timeout for code that you trust"
        require_isolation(remedy, unconfined=isolation.unconfined)
    return [each if each.where is None else replace(each, isolation=isolation) for each in asked]


def with_noise_and_form(asked: Sequence[Asked], noise: Noise | Literal["both"], form: str = "") -> list[Asked]:
    """Set the noise and the form of user code among the requests; `both` requests each with its own noise, too."""
    found: list[Asked] = []
    for each in asked:
        if each.where is None:
            found.append(each)
            continue
        kinds = ("recording", "file") if noise == "both" else (noise,)
        for kind in kinds:
            label = f"{each.label} (own noise)" if noise == "both" and kind == "file" else each.label
            found.append(replace(each, label=label, where=each.where._replace(noise=kind, form=form)))
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
        return Asked(label, call=what)
    if not set(":=/\\") & set(what) and not what.endswith(".py"):
        return Asked(label or what, entry_of(what).name)
    where = address(what)
    return Asked(label or where.label, where=where)


def _digest_of(call: Estimator) -> str:
    """Return the SHA-256 of a callable's name and of the file that defines it, if there is one."""
    module = inspect.getmodule(call)
    file = getattr(module, "__file__", None)
    content = Path(file).read_bytes() if file is not None and Path(file).is_file() else b""
    name = getattr(call, "__qualname__", type(call).__qualname__)
    return hashlib.sha256(name.encode() + content).hexdigest()
