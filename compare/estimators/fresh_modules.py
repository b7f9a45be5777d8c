"""People's code afresh for every run: what one run leaves in global lists and arrays, the next one does not find."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Generator, Iterator
from contextlib import AbstractContextManager, contextmanager
from copy import deepcopy
from types import FunctionType, ModuleType
from typing import Any, NamedTuple, Protocol

import numpy as np

from slamgauge.compare.estimators.private_import import present
from slamgauge.compare.estimators.user_code import Address, Callee, load_own_module

CHANGING = ("add", "append", "clear", "extend", "insert", "pop", "remove", "update")  # methods of lists and dicts
PLAIN = (bool, int, float, complex, str, type(None), np.ndarray, np.generic)


class Fresh(NamedTuple):
    """A callable with globals that no run has touched, and all names beside it."""

    callee: Callee
    beside: dict[str, Any]


class Code(Protocol):
    """A callable that can be had as new."""

    def fresh(self) -> AbstractContextManager[Fresh]:
        """The callable as its file leaves it, for a run."""
        ...


class AddressedCode:
    """A callable in a file or module, which is loaded again for every run.

    Args:
        where: its address.
        loaded: its module, which no run has touched yet; that of a file serves the first run.
    """

    def __init__(self, where: Address, loaded: ModuleType) -> None:
        self._where = where
        self._untouched = iter([_cleared(loaded, where)] if where.sources is not None else [])

    def __getstate__(self) -> dict[str, object]:
        """What travels to another process: the address, by which the module is loaded there."""
        return {"_where": self._where, "_untouched": iter(())}

    @contextmanager
    def fresh(self) -> Generator[Fresh]:
        """The callable of a loading; a simulation that its file runs while it is loaded leaves nothing behind."""
        module = next(self._untouched, None) or _cleared(load_own_module(self._where), self._where)
        with present(module):
            yield Fresh(getattr(module, self._where.attribute), vars(module))


class GivenCode:
    """A callable that a program has at hand: copied as it stands now, with the data and functions of its module.

    Only functions of that module are copied, and globals that are plain data; all else is shared.

    Args:
        given: the callable.
    """

    def __init__(self, given: Callee) -> None:
        self._kept = _copied(given).callee

    @contextmanager
    def fresh(self) -> Generator[Fresh]:
        """A copy."""
        yield _copied(self._kept)


def as_it_stands(given: Callee) -> Fresh:
    """A callable that a program has at hand, not copied: to look at, not to run."""
    return Fresh(given, given.__globals__ if isinstance(given, FunctionType) else {})


def _copied(given: Callee) -> Fresh:
    if not isinstance(given, FunctionType):
        return Fresh(given, {})
    space = {name: deepcopy(value) if _is_data(value) else value for name, value in given.__globals__.items()}
    for name, value in space.items():
        if isinstance(value, FunctionType) and value.__globals__ is given.__globals__:
            space[name] = _moved(value, space)
    return Fresh(_moved(given, space), space)


def _moved(function: FunctionType, space: dict[str, object]) -> FunctionType:
    """The function with other globals."""
    moved = FunctionType(function.__code__, space, function.__name__, function.__defaults__, function.__closure__)
    moved.__kwdefaults__ = function.__kwdefaults__
    moved.__module__ = function.__module__
    return moved


def _is_data(value: object) -> bool:
    """Whether it is made of numbers, texts and arrays alone."""
    if isinstance(value, dict):
        return all(_is_data(each) for pair in value.items() for each in pair)
    if isinstance(value, list | tuple | set | frozenset):
        return all(map(_is_data, value))
    return isinstance(value, PLAIN)


def _cleared(module: ModuleType, where: Address) -> ModuleType:
    """The module, globals that its functions change set to their first values again."""
    loaded = getattr(module, where.attribute)
    if isinstance(loaded, FunctionType):
        with present(module):
            loaded.__globals__.update(_first_values(loaded))
    return module


def _first_values(function: FunctionType) -> dict[str, object]:
    """Globals that the file sets to a plain value and changes in its functions, by their names."""
    try:
        tree = ast.parse(inspect.getsource(inspect.getmodule(function) or function))
    except (OSError, TypeError, SyntaxError):
        return {}
    inside = {name for node in tree.body if isinstance(node, ast.FunctionDef) for name in _changed(node)}
    found: dict[str, object] = {}
    for node in tree.body:
        target = node.targets[0] if isinstance(node, ast.Assign) else None
        if isinstance(node, ast.Assign) and isinstance(target, ast.Name) and target.id in inside:
            try:
                found[target.id] = ast.literal_eval(node.value)
            except ValueError:  # computed
                continue
    return found


def _changed(function: ast.FunctionDef) -> Iterator[str]:
    """Names that a function declares global, calls a changing method of, or sets elements of."""
    for node in ast.walk(function):
        if isinstance(node, ast.Global):
            yield from node.names
        is_method = isinstance(node, ast.Attribute) and node.attr in CHANGING
        is_element = isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store)
        owner = node.value if isinstance(node, ast.Attribute | ast.Subscript) and (is_method or is_element) else None
        if isinstance(owner, ast.Name):
            yield owner.id
