"""Compilation of kernels: by numba on first use, kept on disk for later processes (`kernel_cache`)."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from numba import njit, typeof
from numba.core.types import unliteral
from numba.core.dispatcher import Dispatcher
from numba.extending import overload, register_jitable

from slamgauge.arrays import select
from slamgauge.kernel_cache import cache_of

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def kernel(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Compile `function` on first call; machine code is cached on disk where that is possible."""
    return _compiled(function, callable_from_python=True)


def inner(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """A kernel for other kernels alone: no way into it from Python is compiled, half the time where it is small."""
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

    chosen.__signature__ = template  # pyright: ignore[reportFunctionMemberAccess]
    overload(function)(chosen)


def _choose(condition: Any, one: Any, other: Any) -> Any:
    """Return `select` for numbers."""
    return one if condition else other


replaced_in_kernels(select, _choose)


def _compiled(function: Callable[Arguments, Result], *, callable_from_python: bool) -> Callable[Arguments, Result]:
    options: dict[str, Any] = {  # numba's stubs lack the last two
        "error_model": "numpy",
        "no_cfunc_wrapper": True,
        "no_cpython_wrapper": not callable_from_python,
    }
    dispatcher: Any = njit(**options)(function)
    dispatcher._cache = cache_of(function)  # where `cache=True` puts numba's own
    template = dispatcher.get_call_template
    # a number written in a call is a type of its own to numba: without this it compiles the kernel again for it
    dispatcher.get_call_template = lambda args, kws: template([*map(unliteral, args)], kws)
    return dispatcher


def direct(function: Callable[Arguments, Result], *arguments: object) -> Callable[Arguments, Result]:
    """The machine code of a kernel for arguments of these types, compiled if it is not yet.

    A call then spares numba's look at every argument's type, a microsecond where there are a dozen arrays: they must be
    of the same types each time. What is no kernel is returned as it is.
    """
    if not isinstance(function, Dispatcher):
        return function
    return function.compile(tuple(map(typeof, arguments)))
