"""What the source of a step function reads: global names, columns of y, starts of passed values."""

from __future__ import annotations

import ast
import inspect
import textwrap
from types import CodeType, FunctionType
from typing import Any

import numpy as np

from slamgauge.compare.estimators.forms.signatures import Callee, parameters


def names_read(function: Callee) -> set[str]:
    """Return the global names that a function and the functions of its module that it calls read."""
    space: dict[str, Any] = getattr(function, "__globals__", {})
    waiting, found = [getattr(function, "__code__", None)], set[CodeType]()
    while waiting:
        code = waiting.pop()
        if isinstance(code, CodeType) and code not in found:
            found.add(code)
            called = [space.get(name) for name in code.co_names]
            waiting += [*code.co_consts, *(each.__code__ for each in called if isinstance(each, FunctionType))]
    return {name for each in found for name in each.co_names}


def width_of_bearings(function: Callee, number: int, Py: Any) -> int:
    """Return the columns of y, the parameter `number`, for bearings.

    They follow from the highest column that the code reads, or else from the rows of Py.
    """
    name = parameters(function)[number].name
    read = max((_last_column(node, name) for node in ast.walk(_tree(function))), default=0)
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


def starts_where_called(function: Callee, number: int) -> list[Any]:
    """Return the value of the parameter `number` where the file calls the function; an empty list if it is not found.

    The value is an expression, or a variable that the calling function has assigned one before.
    """
    module, name = inspect.getmodule(function), getattr(function, "__name__", "")
    whole = _tree(module)
    for scope in (*(each for each in ast.walk(whole) if isinstance(each, ast.FunctionDef)), whole):
        for call in ast.walk(scope):
            if isinstance(call, ast.Call) and ast.unparse(call.func) == name and len(call.args) > number:
                given = call.args[number]
                found = _assigned(scope, given.id, call.lineno) if isinstance(given, ast.Name) else given
                if found is not None:
                    try:
                        return [eval(ast.unparse(found), dict(vars(module)))]  # it is the user's own code
                    except NameError:  # a local variable has another value
                        continue
    return []


def _assigned(scope: ast.AST, name: str, before: int) -> ast.expr | None:
    """Return the first expression that a function assigns to a name above a line."""
    for node in ast.walk(scope):
        if isinstance(node, ast.Assign) and node.lineno < before:
            for target in node.targets:
                pairs = [(target, node.value)]
                if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                    pairs = [*zip(target.elts, node.value.elts, strict=False)]
                for each, value in pairs:
                    if isinstance(each, ast.Name) and each.id == name:
                        return value
    return None


def _tree(given: object) -> ast.AST:
    """Parse the source of a function or module; return an empty module if Python does not find it."""
    try:
        return ast.parse(textwrap.dedent(inspect.getsource(given)))  # pyrefly: ignore[bad-argument-type]
    except (OSError, TypeError, SyntaxError):
        return ast.Module([], [])
