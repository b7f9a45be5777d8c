"""What the source of a step function reads: global names, columns of y, and the values that it passes on."""

from __future__ import annotations

import ast
import inspect
import textwrap
from types import CodeType, FunctionType
from typing import Any

import numpy as np

from slamgauge.compare.estimators.forms.signatures import parameters
from slamgauge.compare.estimators.user_code import Callee

OF_DICTS = ("get", "items", "keys", "setdefault", "values")


def tree_of(function: Callee) -> ast.AST:
    """Parse the source of a function; return an empty module if Python does not find it."""
    try:
        return ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError, SyntaxError):
        return ast.Module([], [])


def names_read(function: Callee) -> set[str]:
    """Return the global names that a function and the functions of its module that it calls read."""
    space: dict[str, Any] = getattr(function, "__globals__", {})
    found: set[str] = set()
    waiting = [getattr(function, "__code__", None)]
    while waiting:
        code = waiting.pop()
        if not isinstance(code, CodeType):
            continue
        waiting += [each for each in code.co_consts if isinstance(each, CodeType)]
        for name in {*code.co_names} - found:
            found.add(name)
            value = space.get(name)
            if isinstance(value, FunctionType) and value.__globals__ is space:
                waiting.append(value.__code__)
    return found


def is_a_dict(function: Callee, name: str) -> bool:
    """Return whether a function uses one of its parameters as a dict."""
    for node in ast.walk(tree_of(function)):
        if not isinstance(node, ast.Subscript | ast.Attribute):
            continue
        is_dict = isinstance(node.ctx, ast.Store) if isinstance(node, ast.Subscript) else node.attr in OF_DICTS
        if is_dict and isinstance(node.value, ast.Name) and node.value.id == name:
            return True
    return False


def width_of_bearings(function: Callee, number: int, Py: Any) -> int:
    """Return the columns of y, the parameter `number`, for bearings.

    They follow from the highest column that the code reads, or else from the rows of Py.
    """
    name = parameters(function)[number].name
    read = max((_last_column(node, name) for node in ast.walk(tree_of(function))), default=0)
    if read:
        return 3 if read > 1 else 2
    return 3 if np.shape(Py)[:1] == (2,) else 2


def _last_column(node: ast.AST, name: str) -> int:
    """Return the highest column that `name[i, column]` or `name[i, a:b]` reads; 0 for other nodes."""
    if not isinstance(node, ast.Subscript) or not isinstance(node.value, ast.Name) or node.value.id != name:
        return 0
    column = node.slice.elts[1] if isinstance(node.slice, ast.Tuple) and len(node.slice.elts) == 2 else None
    end = column.upper if isinstance(column, ast.Slice) else column
    value = end.value if isinstance(end, ast.Constant) else 0
    return value - isinstance(column, ast.Slice) if isinstance(value, int) else 0
