"""Noise inside the functions of the Octave course: the matrix that they add to the propagated covariance.

    sigma = G @ sigma @ G.T + R          K = sigma @ H.T @ inv(H @ sigma @ H.T + Q)

In whatever spelling, one operand of such a sum contains the covariance and a transposed matrix, and the other one does
not contain the covariance. This other operand can be replaced, by another syntax tree of the function. The file and its
globals do not change.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from types import FunctionType
from typing import Any

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.step_source import tree_of

HOOK = "_replaced_noise"  # name of the function that replaces the operand
TRANSPOSED = ("T", "transpose")


def with_noise(function: Any, cov: str, replaced: Callable[[Any], Float]) -> Any:
    """Return the function with `replaced(operand)` instead of the noise; None unless it has exactly one such sum.

    Args:
        function: a function of a file.
        cov: name of the parameter with the covariance.
        replaced: receives the noise matrix of the file, and returns that to use.
    """
    (definition,) = getattr(tree_of(function), "body", None) or [None]
    if not isinstance(function, FunctionType) or not isinstance(definition, ast.FunctionDef) or function.__closure__:
        return None
    sums = _Sums(cov)
    sums.visit(definition)
    if sums.count != 1:
        return None
    ast.increment_lineno(definition, function.__code__.co_firstlineno - 1)
    maker = ast.parse(f"def made({HOOK}): return {function.__name__}")
    made = maker.body[0]
    made.body.insert(0, definition)  # pyrefly: ignore[missing-attribute]
    names: dict[str, Any] = {}
    code = compile(ast.fix_missing_locations(maker), function.__code__.co_filename, "exec")
    exec(code, function.__globals__, names)
    return names["made"](replaced)


class _Sums(ast.NodeTransformer):
    """Wraps the noise of all sums of a propagated covariance and noise, and counts them."""

    def __init__(self, cov: str) -> None:
        self._cov = cov
        self.count = 0

    def visit_BinOp(self, node: ast.BinOp) -> ast.BinOp:
        """Wrap the operand without the covariance."""
        self.generic_visit(node)
        if not isinstance(node.op, ast.Add):
            return node
        for side, other in (("left", "right"), ("right", "left")):
            if self._is_propagated(getattr(node, side)) and not self._has_cov(getattr(node, other)):
                self.count += 1
                setattr(node, other, ast.Call(ast.Name(HOOK, ast.Load()), [getattr(node, other)], []))
        return node

    def _is_propagated(self, node: ast.expr) -> bool:
        is_transposed = any(isinstance(each, ast.Attribute) and each.attr in TRANSPOSED for each in ast.walk(node))
        return is_transposed and self._has_cov(node)

    def _has_cov(self, node: ast.expr) -> bool:
        return any(isinstance(each, ast.Name) and each.id == self._cov for each in ast.walk(node))
