"""User code as new for every run, so that no run finds what an earlier run left in global lists and arrays."""

from __future__ import annotations

import ast
import inspect
import os
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from copy import deepcopy
from functools import lru_cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np

from slamgauge.compare.estimators.needed_code import compiled
from slamgauge.compare.estimators.private_import import in_use, present
from slamgauge.compare.estimators.sources import Sources
from slamgauge.compare.estimators.user_code import Address, Callee, load_callable_module

CHANGING = ("add", "append", "clear", "extend", "insert", "pop", "remove", "update")  # methods of lists, sets, dicts
PLAIN = (bool, int, float, complex, str, type(None), np.ndarray, np.generic)  # types that are copied


class Fresh(NamedTuple):
    """A callable whose globals no run has changed, and all names of its module."""

    callee: Callee
    names: dict[str, Any]


class AddressedCode:
    """A callable of a file or module, which is loaded again for every run.

    Args:
        where: the address.
        loaded: the module, before any run; the first run of a file uses it.
    """

    def __init__(self, where: Address, loaded: ModuleType) -> None:
        self._where = where
        self._untouched = iter([_cleared(loaded, where)] if where.sources is not None else [])

    def __getstate__(self) -> dict[str, object]:
        """Return the address; another process loads the module from it."""
        return {"_where": self._where, "_untouched": iter(())}

    @contextmanager
    def fresh(self) -> Generator[Fresh]:
        """Load the callable; a simulation that its file runs at import does not change its first run."""
        module = next(self._untouched, None) or _cleared(load_callable_module(self._where), self._where)
        with in_use(module):
            yield Fresh(getattr(module, self._where.attribute), vars(module))


class GivenCode:
    """A callable given in Python: for every run it is copied as it was at first, with its module's functions and data.

    Data are copied if they consist of numbers, texts and arrays; all other globals are shared.
    """

    def __init__(self, given: Callee) -> None:
        self._kept = _copied(given).callee

    @contextmanager
    def fresh(self) -> Generator[Fresh]:
        """Copy the callable."""
        yield _copied(self._kept)


Code = AddressedCode | GivenCode


def uncopied(given: Callee) -> Fresh:
    """Return a callable given in Python for inspection, not for runs."""
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
    """Return the function with other globals."""
    moved = FunctionType(function.__code__, space, function.__name__, function.__defaults__, function.__closure__)
    moved.__kwdefaults__ = function.__kwdefaults__
    moved.__module__ = function.__module__
    return moved


def _is_data(value: object) -> bool:
    """Return whether a value consists of numbers, texts and arrays."""
    if isinstance(value, dict):
        return all(_is_data(each) for pair in value.items() for each in pair)
    if isinstance(value, list | tuple | set | frozenset):
        return all(map(_is_data, value))
    return isinstance(value, PLAIN)


def _cleared(module: ModuleType, where: Address) -> ModuleType:
    """Reset globals that the functions of the module change to the values that its source gives them."""
    loaded = getattr(module, where.attribute)
    if isinstance(loaded, FunctionType):
        with present(module):
            loaded.__globals__.update(_first_values(loaded))
    return module


def _first_values(function: FunctionType) -> dict[str, object]:
    """Return the literal values of globals that functions of the file change, by name."""
    try:
        source = inspect.getsource(inspect.getmodule(function) or function)
    except (OSError, TypeError):
        return {}
    return {name: ast.literal_eval(value) for name, value in _literals(source).items()}


def prepare(sources: Sources) -> None:
    """Parse and compile files of user code, so that the processes that this one forks need not. Nothing of it runs."""
    for path, content in sources.files:
        with suppress(Exception):  # an error that loading shows
            compiled(content, os.path.normpath(Path(sources.folder, path)), ())
            _literals(content.decode())


@lru_cache(maxsize=64)
def _literals(source: str) -> dict[str, ast.expr]:
    """Return the last literal that a module assigns to each of the globals that its functions change."""
    try:
        tree = ast.parse(source)
    except SyntaxError:
        return {}
    inside = {name for node in tree.body if isinstance(node, ast.FunctionDef) for name in _changed(node)}
    found: dict[str, ast.expr] = {}
    for node in tree.body:
        target = node.targets[0] if isinstance(node, ast.Assign) else None
        if isinstance(node, ast.Assign) and isinstance(target, ast.Name) and target.id in inside:
            with suppress(ValueError):  # not a literal
                ast.literal_eval(node.value)
                found[target.id] = node.value
    return found


def _changed(function: ast.FunctionDef) -> Iterator[str]:
    """Yield names that a function declares global, whose elements it sets, or whose changing methods it calls."""
    for node in ast.walk(function):
        if isinstance(node, ast.Global):
            yield from node.names
        is_method = isinstance(node, ast.Attribute) and node.attr in CHANGING
        is_element = isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store)
        owner = node.value if isinstance(node, ast.Attribute | ast.Subscript) and (is_method or is_element) else None
        if isinstance(owner, ast.Name):
            yield owner.id
