"""Compilation of kernels by numba on first use; `kernel_cache` stores the machine code on disk."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from numba import njit, typeof
from numba.core.dispatcher import Dispatcher
from numba.core.types import unliteral
from numba.extending import overload, register_jitable

from slamgauge.arrays import select
from slamgauge.kernel_cache import cache_of
from slamgauge.linked_code import compile_for_kernels

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def kernel(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Compile `function` on first call; machine code is cached on disk if possible."""
    return _compiled(function, callable_from_python=True)


def inner(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Compile a kernel that only kernels call: without an entry from Python, which halves the time of small ones."""
    return _compiled(function, callable_from_python=False)


def callable_in_kernels(*functions: Callable[..., object]) -> None:
    """Let kernels call these plain Python functions: each kernel compiles them with itself."""
    for function in functions:
        register_jitable(function)


def replaced_in_kernels(function: Callable[..., object], by: Callable[..., object]) -> None:
    """Let kernels compile `by` where they call `function`; both have the same parameters and annotations."""
    template = inspect.signature(function)

    def chosen(*_: object) -> Callable[..., object]:
        return by

    chosen.__signature__ = template  # pyrefly: ignore[missing-attribute]
    overload(function)(chosen)


def _choose(condition: Any, one: Any, other: Any) -> Any:
    """Return `select` for numbers."""
    return one if condition else other


replaced_in_kernels(select, _choose)


def _compiled(function: Callable[Arguments, Result], *, callable_from_python: bool) -> Callable[Arguments, Result]:
    """Compile `function` without an entry from Python for other kernels, and separately with one if it is needed."""
    inside = _dispatcher(function, callable_from_python=False)
    template = inside.get_call_template

    def without_literals(arguments: Any, keywords: Any) -> Any:
        """Replace types of single numbers, which numba gives to numbers written in a call, by `int64` or `float64`."""
        return template([*map(unliteral, arguments)], keywords)

    inside.get_call_template = without_literals
    if not callable_from_python:
        return inside
    outside = _dispatcher(function, callable_from_python=True)
    outside.get_call_template, outside.get_overload = without_literals, inside.get_overload  # for calls in kernels
    return outside


def _dispatcher(function: Callable[..., object], *, callable_from_python: bool) -> Any:
    options: dict[str, Any] = {  # numba's stubs lack the last two
        "error_model": "numpy",
        "no_cfunc_wrapper": True,
        "no_cpython_wrapper": not callable_from_python,
    }
    dispatcher: Any = njit(**options)(function)
    if not callable_from_python:
        compile_for_kernels(dispatcher)
    dispatcher._cache = cache_of(function, callable_from_python=callable_from_python)  # in place of numba's own
    return dispatcher


def direct(function: Callable[Arguments, Result], *arguments: object) -> Callable[Arguments, Result]:
    """Return the machine code of a kernel for arguments of these types, compiled if necessary.

    Calls of the machine code skip numba's check of argument types (1 us for a dozen arrays): the types must be the same
    each time. A plain Python function is returned unchanged.
    """
    if not isinstance(function, Dispatcher):
        return function
    return function.compile(tuple(map(typeof, arguments)))
