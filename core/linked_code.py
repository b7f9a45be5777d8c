"""Code of kernels that only kernels call, without machine code of its own.

numba optimises each kernel and translates it to machine code, together with all kernels that it calls: the code of a
kernel under four others is optimised and translated five times. The kernels here keep the code before both steps.
It is optimised and translated once for each kernel that Python calls, which halves the time of a first use.
"""

from __future__ import annotations

from copy import copy
from types import SimpleNamespace
from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.registry import cpu_target


class _LinkedCode(JITCodeLibrary):
    """Code of a kernel and of all kernels that it calls."""

    def _optimize_final_module(self) -> None:
        """Leave the code as it is: the kernels that link it optimise it."""

    def _finalize_final_module(self) -> None:
        """Accept no more code, and generate no machine code."""
        self._finalize_dynamic_globals()
        self._finalized = True

    def serialize_using_object_code(self) -> Any:
        """Return the content of a cached file, which has no machine code."""
        return self.serialize_using_bitcode()


def _target() -> Any:
    """Return numba's compiler for this processor, with `_LinkedCode` for the code of a kernel."""
    processor: Any = cpu_target
    codegen = copy(processor.target_context.codegen())
    codegen._library_class, codegen.set_env = _LinkedCode, _set_no_environment
    return SimpleNamespace(
        options=processor.options,
        typing_context=processor.typing_context,
        target_context=processor.target_context.subtarget(_internal_codegen=codegen),
    )


def _set_no_environment(name: str, environment: object) -> None:
    """Ignore the Python objects that machine code refers to."""


_TARGET = _target()


def compile_for_kernels(dispatcher: Any) -> None:
    """Let a numba dispatcher compile code that kernels link and Python cannot call."""
    dispatcher.targetctx, dispatcher._compiler.targetdescr = _TARGET.target_context, _TARGET
